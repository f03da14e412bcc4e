//! Drivers of the rig's devices behind the traits of `evrig-record`.

pub mod davis;
pub mod dobot;
pub mod pi;
pub mod serial_port;
pub mod stimulus;
pub mod stream_server;
