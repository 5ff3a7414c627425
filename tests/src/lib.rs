//! End-to-end tests, and the mission of `make demo`.
