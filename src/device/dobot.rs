//! The Dobot Magician: a robot arm on a serial line.

pub mod alarm;
pub mod command;
pub mod fields;
pub mod frame;
pub mod id;
pub mod reply;
