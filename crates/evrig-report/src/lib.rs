//! Reports: a self-contained HTML page, plots, and the table of measures for a terminal.
//!
//! Functions in [`plot`] turn values into a [`figure::Figure`] with caption and alternative text;
//! [`page::Page`] collects figures and tables; [`page::Page::to_html`] writes one file that loads
//! nothing and is complete without script. No result is computed here.

pub mod answer;
pub mod calibration;
pub mod camera_report;
pub mod diagnosis;
pub mod figure;
pub mod latex;
pub mod measure;
pub mod number;
pub mod page;
pub mod plot;
pub mod scene;
pub mod session;
pub mod table;
pub mod terminal;
pub mod tracking;
pub mod verdict;
pub mod words;
