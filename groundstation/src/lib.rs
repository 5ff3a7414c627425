//! The operator's app: one fused map, plans and commands.

pub mod render;
