//! A simulated world: scene, cameras, vehicles and their autopilots.
