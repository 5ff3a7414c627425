// GeographicLib's local Cartesian coordinates on WGS-84.
#pragma once

#include <array>

#include "rust/cxx.h"

namespace tandem {

// East, north, up in metres of a place given as latitude and longitude in degrees and height in metres.
std::array<double, 3> forward(const std::array<double, 3> &origin,
                              const std::array<double, 3> &place);

// The other way.
std::array<double, 3> reverse(const std::array<double, 3> &origin,
                              const std::array<double, 3> &enu);

} // namespace tandem
