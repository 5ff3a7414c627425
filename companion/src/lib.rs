//! The on-board service: sensors to SLAM to a map on the wire.
