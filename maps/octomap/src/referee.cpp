#include "octomap/src/referee.h"

#include <stdexcept>
#include <string>

namespace tandem {

Referee::Referee(std::unique_ptr<octomap::OcTree> tree) : tree_(std::move(tree)) {}

double Referee::resolution() const { return tree_->getResolution(); }

std::size_t Referee::nodes() const { return tree_->size(); }

std::uint64_t Referee::count(bool occupied_only) const {
  std::uint64_t voxels = 0;
  for (auto leaf = tree_->begin_leafs(); leaf != tree_->end_leafs(); ++leaf) {
    if (!occupied_only || tree_->isNodeOccupied(*leaf)) {
      voxels += std::uint64_t{1} << (3 * (tree_->getTreeDepth() - leaf.getDepth()));
    }
  }
  return voxels;
}

std::uint64_t Referee::occupied() const { return count(true); }

std::uint64_t Referee::known() const { return count(false); }

std::uint8_t Referee::occupancy(double x, double y, double z) const {
  const octomap::OcTreeNode *node = tree_->search(x, y, z);
  if (node == nullptr) {
    return 0;
  }
  return tree_->isNodeOccupied(node) ? 2 : 1;
}

bool Referee::write_ot(rust::Str path) { return tree_->write(std::string(path)); }

bool Referee::write_bt(rust::Str path) { return tree_->writeBinary(std::string(path)); }

void Referee::insert_scan(rust::Slice<const double> points, double x, double y, double z) {
  octomap::Pointcloud cloud;
  for (std::size_t i = 0; i + 2 < points.size(); i += 3) {
    cloud.push_back(static_cast<float>(points[i]), static_cast<float>(points[i + 1]),
                    static_cast<float>(points[i + 2]));
  }
  const octomap::point3d origin(static_cast<float>(x), static_cast<float>(y),
                                static_cast<float>(z));
  // No limit of range, each voxel's parents updated, one ray an end voxel.
  tree_->insertPointCloud(cloud, origin, -1.0, false, true);
}

std::unique_ptr<Referee> empty(double resolution) {
  return std::make_unique<Referee>(std::make_unique<octomap::OcTree>(resolution));
}

std::unique_ptr<Referee> read(rust::Str path) {
  const std::string name(path);
  std::unique_ptr<octomap::AbstractOcTree> read;
  if (name.size() > 3 && name.substr(name.size() - 3) == ".bt") {
    auto tree = std::make_unique<octomap::OcTree>(0.1);
    if (!tree->readBinary(name)) {
      throw std::runtime_error("liboctomap does not read " + name);
    }
    return std::make_unique<Referee>(std::move(tree));
  }
  read.reset(octomap::AbstractOcTree::read(name));
  auto *tree = dynamic_cast<octomap::OcTree *>(read.get());
  if (tree == nullptr) {
    throw std::runtime_error("liboctomap does not read " + name);
  }
  read.release();
  return std::make_unique<Referee>(std::unique_ptr<octomap::OcTree>(tree));
}

} // namespace tandem
