//! Sensor messages and where they come from: TUM folders and MCAP files.
