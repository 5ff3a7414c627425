//! WGS-84 to local east-north-up and back, through GeographicLib.
