//! Tandem's MAVLink dialect, services, object transport and links.
