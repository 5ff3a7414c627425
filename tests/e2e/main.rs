//! End-to-end tests, one module per user story.

mod architecture;
mod dataset;
mod evo;
mod mission;
mod peers;
mod programs;
mod recording;
mod replay;
mod soak;
mod zenoh;
