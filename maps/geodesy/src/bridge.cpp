#include "geodesy/src/bridge.h"

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>

namespace tandem {

namespace {

GeographicLib::LocalCartesian local(const std::array<double, 3> &origin) {
  return {origin[0], origin[1], origin[2], GeographicLib::Geocentric::WGS84()};
}

} // namespace

std::array<double, 3> forward(const std::array<double, 3> &origin,
                              const std::array<double, 3> &place) {
  std::array<double, 3> enu{};
  local(origin).Forward(place[0], place[1], place[2], enu[0], enu[1], enu[2]);
  return enu;
}

std::array<double, 3> reverse(const std::array<double, 3> &origin,
                              const std::array<double, 3> &enu) {
  std::array<double, 3> place{};
  local(origin).Reverse(enu[0], enu[1], enu[2], place[0], place[1], place[2]);
  return place;
}

} // namespace tandem
