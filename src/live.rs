//! The live view of the devices: rates, drops, frames with the tag, events.
//!
//! Events and the event camera's frames go out as AEDAT4 over TCP, so that DV's tools and
//! dv-processing connect; with the feature `foxglove`, everything goes to Foxglove's WebSocket too.
//! A viewer never blocks: each has a bounded queue, and messages beyond it are dropped and counted,
//! so the view is always current.

#[cfg(feature = "foxglove")]
mod foxglove;
mod generation;
mod status;
mod view;

pub use generation::{Generation, GenerationSettings, GenerationTally, PiLight};
pub use status::LiveStatus;
pub use view::{EventImage, LiveView};

use evrig_core::geometry::Size;
use evrig_device::stream_server::{StreamServer, StreamServerError};
use evrig_format::aedat4::{Compression, Content, StreamSpec};
use evrig_generate::ParameterError;
use evrig_record::recorder::RecorderSample;
use evrig_session::HostTime;
use evrig_session::rig::Pose;
use std::net::SocketAddr;

/// Where viewers connect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Addresses {
    /// AEDAT4 events.
    pub events: SocketAddr,
    /// AEDAT4 frames.
    pub frames: SocketAddr,
    /// Foxglove's WebSocket.
    pub foxglove: Option<SocketAddr>,
}

/// Why nothing is shown.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The view is not encrypted.
    #[error("{address} can be reached from outside; use 127.0.0.1, and `ssh -L` from elsewhere")]
    NotLoopback {
        /// Where it was to listen.
        address: SocketAddr,
    },
    /// The generator's parameters.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// The AEDAT4 streams.
    #[error(transparent)]
    Serve(#[from] StreamServerError),
    /// The tag's family.
    #[error("`{family}` is no family of tags that this version knows")]
    Tag {
        /// Its name.
        family: String,
    },
    /// Foxglove's server.
    #[error("Foxglove's server at {address}: {because}")]
    Foxglove {
        /// Where.
        address: SocketAddr,
        /// Its error.
        because: String,
    },
    /// This program has no such server.
    #[error("this evrig was built without Foxglove's server; build it with `--features foxglove`")]
    WithoutFoxglove,
}

/// The view, served until it is dropped.
#[derive(Debug)]
pub struct Live {
    events: StreamServer,
    frames: StreamServer,
    view: LiveView,
    #[cfg(feature = "foxglove")]
    foxglove: Option<foxglove::Foxglove>,
}

impl Live {
    /// Serves a view of cameras of these sizes at addresses of the loopback interface; `tag` is the
    /// family and number to look for.
    ///
    /// # Errors
    /// When an address is taken or not of this machine alone, or the family is unknown.
    pub fn serve(
        addresses: Addresses,
        size: Size,
        source: &str,
        tag: (&str, u32),
    ) -> Result<Self, LiveError> {
        let all = [Some(addresses.events), Some(addresses.frames), addresses.foxglove];
        if let Some(address) = all.into_iter().flatten().find(|at| !at.ip().is_loopback()) {
            return Err(LiveError::NotLoopback { address });
        }
        #[cfg(not(feature = "foxglove"))]
        if addresses.foxglove.is_some() {
            return Err(LiveError::WithoutFoxglove);
        }
        let compression = Compression::Lz4;
        Ok(Self {
            events: StreamServer::bind(
                addresses.events,
                &StreamSpec::events(size, source),
                compression,
            )?,
            frames: StreamServer::bind(
                addresses.frames,
                &StreamSpec::frames(size, source),
                compression,
            )?,
            view: LiveView::new(size, tag)?,
            #[cfg(feature = "foxglove")]
            foxglove: addresses.foxglove.map(foxglove::Foxglove::serve).transpose()?,
        })
    }

    /// Where the events are.
    #[must_use]
    pub fn events(&self) -> &StreamServer {
        &self.events
    }

    /// Where the frames are.
    #[must_use]
    pub fn frames(&self) -> &StreamServer {
        &self.frames
    }

    /// Where Foxglove connects, if it can.
    #[must_use]
    pub fn foxglove(&self) -> Option<SocketAddr> {
        #[cfg(feature = "foxglove")]
        return self.foxglove.as_ref().map(foxglove::Foxglove::address);
        #[cfg(not(feature = "foxglove"))]
        None
    }

    /// Takes what a device delivered and hands it on.
    ///
    /// # Errors
    /// When it cannot be written as AEDAT4.
    pub fn take(&mut self, sample: &RecorderSample) -> Result<(), LiveError> {
        self.view.take(sample);
        match sample {
            RecorderSample::Packet { content: Content::Events(events), .. } => {
                self.events.send_events(events.as_slice())?;
            }
            RecorderSample::Packet { content: Content::Frame(frame), .. } => {
                self.frames.send_frame(frame)?;
                let corners = self.view.look(frame);
                #[cfg(feature = "foxglove")]
                if let Some(foxglove) = &self.foxglove {
                    foxglove.davis_frame(frame, corners);
                }
                let _ = corners;
            }
            #[cfg(feature = "foxglove")]
            RecorderSample::Frame { frame, .. } => {
                if let Some(foxglove) = &self.foxglove {
                    foxglove.pi_frame(frame);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Shows the events since the last call as an image. To be called some thirty times a second.
    pub fn show_events(&mut self, now: HostTime) {
        let image = self.view.take_events();
        #[cfg(feature = "foxglove")]
        if let Some(foxglove) = &self.foxglove {
            foxglove.events(&image, now);
        }
        let _ = (image, now);
    }

    /// How it goes since the last call, which it also shows. `n_dropped` is what the devices lost.
    pub fn update_status(
        &mut self,
        now: HostTime,
        pose: Option<Pose>,
        n_dropped: u64,
    ) -> LiveStatus {
        let n_viewer = self.events.n_dropped() + self.frames.n_dropped();
        let status = self.view.status(now, pose, n_dropped, n_viewer);
        #[cfg(feature = "foxglove")]
        if let Some(foxglove) = &self.foxglove {
            foxglove.status(&status, pose, now);
        }
        status
    }
}
