// What the tests ask of Debian's liboctomap.
#pragma once

#include <array>
#include <memory>

#include <octomap/octomap.h>

#include "rust/cxx.h"

namespace tandem {

class Referee {
public:
  explicit Referee(std::unique_ptr<octomap::OcTree> tree);

  double resolution() const;
  std::size_t nodes() const;
  std::uint64_t occupied() const;
  std::uint64_t known() const;
  // 0 unknown, 1 free, 2 occupied
  std::uint8_t occupancy(double x, double y, double z) const;
  bool write_ot(rust::Str path);
  bool write_bt(rust::Str path);
  void insert_scan(rust::Slice<const double> points, double x, double y, double z);
  // The cloud that insert_cloud inserts; apart, so that a bench need not time it.
  void set_cloud(rust::Slice<const float> points);
  // No limit if max_range is negative. Bits of mode: 1 discretized, 2 lazy.
  void insert_cloud(const std::array<float, 3> &origin, double max_range, std::uint8_t mode);
  // After lazy insertion: makes the inner nodes right again.
  void update_inner();
  // As occupancy, of the voxels at these coordinates, three a voxel, counted from the origin of the world.
  std::size_t count_occupied(rust::Slice<const std::int32_t> keys) const;
  void occupancies(rust::Slice<const std::int32_t> keys, rust::Slice<std::uint8_t> states) const;
  // Distances to what rays from one origin meet, unknown voxels let them pass; negative if they meet nothing.
  void cast_rays(const std::array<float, 3> &origin, rust::Slice<const float> directions,
                 double max_range, rust::Slice<float> distances) const;

private:
  std::uint64_t count(bool occupied_only) const;

  std::unique_ptr<octomap::OcTree> tree_;
  octomap::Pointcloud cloud_;
};

// Bytes that malloc has handed out in this process, to C++ and to Rust, with its own overhead.
std::size_t heap_bytes();
// Gives back to the system what malloc keeps for later.
void trim_heap();

std::unique_ptr<Referee> empty(double resolution);
// Throws unless liboctomap reads the file.
std::unique_ptr<Referee> read(rust::Str path);

} // namespace tandem
