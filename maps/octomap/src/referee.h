// What the tests ask of Debian's liboctomap.
#pragma once

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

private:
  std::uint64_t count(bool occupied_only) const;

  std::unique_ptr<octomap::OcTree> tree_;
};

std::unique_ptr<Referee> empty(double resolution);
// Throws unless liboctomap reads the file.
std::unique_ptr<Referee> read(rust::Str path);

} // namespace tandem
