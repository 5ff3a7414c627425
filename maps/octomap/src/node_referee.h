// liboctomap's OcTree and ColorOcTree, voxel by voxel.
#pragma once

#include <array>
#include <memory>

#include <octomap/ColorOcTree.h>
#include <octomap/octomap.h>

#include "rust/cxx.h"

namespace tandem {

// One of the two trees.
class NodeReferee {
public:
  explicit NodeReferee(std::unique_ptr<octomap::OcTree> plain);
  explicit NodeReferee(std::unique_ptr<octomap::ColorOcTree> color);

  // Log-odds of a voxel that may be new; the tree is not pruned.
  void set(std::array<std::uint16_t, 3> key, float log_odds);
  void set_color(std::array<std::uint16_t, 3> key, std::array<std::uint8_t, 3> color);
  void update_inner();
  void prune();
  std::size_t nodes() const;
  bool is_colored() const;
  // NaN if it is unknown.
  float log_odds(std::array<std::uint16_t, 3> key) const;
  // White if it has none.
  std::array<std::uint8_t, 3> color(std::array<std::uint16_t, 3> key) const;
  bool write_ot(rust::Str path) const;
  bool write_bt(rust::Str path) const;

private:
  std::unique_ptr<octomap::OcTree> plain_;
  std::unique_ptr<octomap::ColorOcTree> color_;
};

std::unique_ptr<NodeReferee> plain_nodes(double resolution);
std::unique_ptr<NodeReferee> colored_nodes(double resolution);
// Throws unless liboctomap reads the file as one of the two.
std::unique_ptr<NodeReferee> read_nodes(rust::Str path);

} // namespace tandem
