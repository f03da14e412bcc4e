//! The Pi's camera.
