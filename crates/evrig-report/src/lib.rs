//! What people read: one self-contained page, and the table of measures for a terminal.
//!
//! The way: a plot in [`plot`] turns plain values into a [`figure::Figure`] with caption and
//! alternative text; [`page::Page`] gathers figures and tables; [`page::Page::to_html`] writes
//! one file that loads nothing, runs no foreign script and is complete without its own.
//! Nothing here computes a result: numbers come in with their errors.

pub mod calibration;
pub mod diagnosis;
pub mod figure;
pub mod measure;
pub mod number;
pub mod page;
pub mod plot;
pub mod scene;
pub mod session;
pub mod table;
pub mod target;
pub mod terminal;
