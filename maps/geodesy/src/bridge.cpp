#include "geodesy/src/bridge.h"

#include <string>

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>
#include <GeographicLib/MGRS.hpp>
#include <GeographicLib/UTMUPS.hpp>

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

std::array<double, 4> utm_forward(double lat, double lon) {
  int zone = 0;
  bool north = false;
  double easting = 0;
  double northing = 0;
  GeographicLib::UTMUPS::Forward(lat, lon, zone, north, easting, northing);
  return {static_cast<double>(zone), north ? 1.0 : 0.0, easting, northing};
}

std::array<double, 2> utm_reverse(std::uint8_t zone, bool north, double easting, double northing) {
  std::array<double, 2> place{};
  GeographicLib::UTMUPS::Reverse(zone, north, easting, northing, place[0], place[1]);
  return place;
}

rust::String mgrs_forward(double lat, double lon, std::int32_t digits) {
  int zone = 0;
  bool north = false;
  double easting = 0;
  double northing = 0;
  GeographicLib::UTMUPS::Forward(lat, lon, zone, north, easting, northing);
  std::string text;
  GeographicLib::MGRS::Forward(zone, north, easting, northing, lat, digits, text);
  return text;
}

std::array<double, 3> mgrs_reverse(rust::Str text) {
  int zone = 0;
  bool north = false;
  double easting = 0;
  double northing = 0;
  int digits = 0;
  GeographicLib::MGRS::Reverse(std::string(text), zone, north, easting, northing, digits);
  double lat = 0;
  double lon = 0;
  GeographicLib::UTMUPS::Reverse(zone, north, easting, northing, lat, lon);
  return {lat, lon, static_cast<double>(digits)};
}

GeoidModel::GeoidModel(const std::string &name, const std::string &folder) : geoid_(name, folder) {}

double GeoidModel::height(double lat, double lon) const { return geoid_(lat, lon); }

std::unique_ptr<GeoidModel> open_geoid(rust::Str name, rust::Str folder) {
  return std::make_unique<GeoidModel>(std::string(name), std::string(folder));
}

rust::String geoid_folder() { return GeographicLib::Geoid::DefaultGeoidPath(); }

} // namespace tandem
