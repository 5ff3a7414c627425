// What we ask of GeographicLib, on WGS-84. What it refuses it throws, in its words.
#pragma once

#include <array>
#include <memory>

#include <GeographicLib/Geoid.hpp>

#include "rust/cxx.h"

namespace tandem {

// East, north, up in metres of a place given as latitude and longitude in degrees and height in metres.
std::array<double, 3> forward(const std::array<double, 3> &origin,
                              const std::array<double, 3> &place);

// The other way.
std::array<double, 3> reverse(const std::array<double, 3> &origin,
                              const std::array<double, 3> &enu);

// Zone (0 polar), 1 if north else 0, easting and northing of a latitude and longitude.
std::array<double, 4> utm_forward(double lat, double lon);

// The other way.
std::array<double, 2> utm_reverse(std::uint8_t zone, bool north, double easting, double northing);

// The MGRS square with so many digits for each of easting and northing.
rust::String mgrs_forward(double lat, double lon, std::int32_t digits);

// Latitude and longitude of the middle of a square, and its digits.
std::array<double, 3> mgrs_reverse(rust::Str text);

// A geoid model read from its data file.
class GeoidModel {
public:
  GeoidModel(const std::string &name, const std::string &folder);
  double height(double lat, double lon) const;

private:
  GeographicLib::Geoid geoid_;
};

std::unique_ptr<GeoidModel> open_geoid(rust::Str name, rust::Str folder);

// Where GeographicLib looks for data files.
rust::String geoid_folder();

} // namespace tandem
