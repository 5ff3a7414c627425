#include "octomap/src/node_referee.h"

#include <limits>
#include <stdexcept>
#include <string>

namespace tandem {

namespace {

octomap::OcTreeKey key_of(std::array<std::uint16_t, 3> key) {
  return {key[0], key[1], key[2]};
}

} // namespace

NodeReferee::NodeReferee(std::unique_ptr<octomap::OcTree> plain) : plain_(std::move(plain)) {}

NodeReferee::NodeReferee(std::unique_ptr<octomap::ColorOcTree> color) : color_(std::move(color)) {}

void NodeReferee::set(std::array<std::uint16_t, 3> key, float log_odds) {
  if (plain_) {
    plain_->setNodeValue(key_of(key), log_odds, true);
  } else {
    color_->setNodeValue(key_of(key), log_odds, true);
  }
}

void NodeReferee::set_color(std::array<std::uint16_t, 3> key,
                            std::array<std::uint8_t, 3> color) {
  if (color_) {
    color_->setNodeColor(key_of(key), color[0], color[1], color[2]);
  }
}

void NodeReferee::update_inner() {
  if (plain_) {
    plain_->updateInnerOccupancy();
  } else if (color_->size() > 0) { // liboctomap 1.9 crashes on an empty ColorOcTree
    color_->updateInnerOccupancy();
  }
}

void NodeReferee::prune() {
  if (plain_) {
    plain_->prune();
  } else {
    color_->prune();
  }
}

std::size_t NodeReferee::nodes() const { return plain_ ? plain_->size() : color_->size(); }

bool NodeReferee::is_colored() const { return color_ != nullptr; }

float NodeReferee::log_odds(std::array<std::uint16_t, 3> key) const {
  const octomap::OcTreeNode *node = plain_ ? plain_->search(key_of(key)) : color_->search(key_of(key));
  return node == nullptr ? std::numeric_limits<float>::quiet_NaN() : node->getLogOdds();
}

std::array<std::uint8_t, 3> NodeReferee::color(std::array<std::uint16_t, 3> key) const {
  const octomap::ColorOcTreeNode *node = color_ ? color_->search(key_of(key)) : nullptr;
  if (node == nullptr) {
    return {255, 255, 255};
  }
  return {node->getColor().r, node->getColor().g, node->getColor().b};
}

bool NodeReferee::write_ot(rust::Str path) const {
  const std::string name(path);
  return plain_ ? plain_->write(name) : color_->write(name);
}

bool NodeReferee::write_bt(rust::Str path) const {
  const std::string name(path);
  return plain_ ? plain_->writeBinaryConst(name) : color_->writeBinaryConst(name);
}

std::unique_ptr<NodeReferee> plain_nodes(double resolution) {
  return std::make_unique<NodeReferee>(std::make_unique<octomap::OcTree>(resolution));
}

std::unique_ptr<NodeReferee> colored_nodes(double resolution) {
  return std::make_unique<NodeReferee>(std::make_unique<octomap::ColorOcTree>(resolution));
}

std::unique_ptr<NodeReferee> read_nodes(rust::Str path) {
  const std::string name(path);
  if (name.size() > 3 && name.substr(name.size() - 3) == ".bt") {
    auto tree = std::make_unique<octomap::OcTree>(0.1);
    if (!tree->readBinary(name)) {
      throw std::runtime_error("liboctomap does not read " + name);
    }
    return std::make_unique<NodeReferee>(std::move(tree));
  }
  std::unique_ptr<octomap::AbstractOcTree> tree(octomap::AbstractOcTree::read(name));
  if (auto *plain = dynamic_cast<octomap::OcTree *>(tree.get())) {
    tree.release();
    return std::make_unique<NodeReferee>(std::unique_ptr<octomap::OcTree>(plain));
  }
  if (auto *color = dynamic_cast<octomap::ColorOcTree *>(tree.get())) {
    tree.release();
    return std::make_unique<NodeReferee>(std::unique_ptr<octomap::ColorOcTree>(color));
  }
  throw std::runtime_error("liboctomap does not read " + name);
}

} // namespace tandem
