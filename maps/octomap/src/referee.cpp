#include "octomap/src/referee.h"

#include <malloc.h>

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

void Referee::set_cloud(rust::Slice<const float> points) {
  cloud_.clear();
  cloud_.reserve(points.size() / 3);
  for (std::size_t i = 0; i + 2 < points.size(); i += 3) {
    cloud_.push_back(points[i], points[i + 1], points[i + 2]);
  }
}

void Referee::insert_cloud(const std::array<float, 3> &origin, double max_range,
                           std::uint8_t mode) {
  const octomap::point3d from(origin[0], origin[1], origin[2]);
  tree_->insertPointCloud(cloud_, from, max_range, (mode & 2) != 0, (mode & 1) != 0);
}

void Referee::update_inner() { tree_->updateInnerOccupancy(); }

namespace {

octomap::OcTreeKey key_at(rust::Slice<const std::int32_t> keys, std::size_t i) {
  const auto key = [](std::int32_t c) { return static_cast<octomap::key_type>(c + 32768); };
  return {key(keys[i]), key(keys[i + 1]), key(keys[i + 2])};
}

} // namespace

std::size_t Referee::count_occupied(rust::Slice<const std::int32_t> keys) const {
  std::size_t occupied = 0;
  for (std::size_t i = 0; i + 2 < keys.size(); i += 3) {
    const octomap::OcTreeNode *node = tree_->search(key_at(keys, i));
    occupied += node != nullptr && tree_->isNodeOccupied(node) ? 1 : 0;
  }
  return occupied;
}

void Referee::occupancies(rust::Slice<const std::int32_t> keys,
                          rust::Slice<std::uint8_t> states) const {
  for (std::size_t i = 0; i < states.size() && 3 * i + 2 < keys.size(); ++i) {
    const octomap::OcTreeNode *node = tree_->search(key_at(keys, 3 * i));
    states[i] = node == nullptr ? 0 : tree_->isNodeOccupied(node) ? 2 : 1;
  }
}

void Referee::cast_rays(const std::array<float, 3> &origin, rust::Slice<const float> directions,
                        double max_range, rust::Slice<float> distances) const {
  const octomap::point3d from(origin[0], origin[1], origin[2]);
  for (std::size_t i = 0; i < distances.size() && 3 * i + 2 < directions.size(); ++i) {
    const octomap::point3d towards(directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]);
    octomap::point3d end;
    const bool hit = tree_->castRay(from, towards, end, true, max_range);
    distances[i] = hit ? static_cast<float>((end - from).norm()) : -1.0F;
  }
}

std::size_t heap_bytes() {
  const struct mallinfo2 info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

void trim_heap() { malloc_trim(0); }

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
