//! The target on a screen: image and tag to scale, full-screen in a browser, one image after
//! another.
//!
//! A page on loopback polls the state, shows it, and confirms once it is on the screen; an image
//! that was not confirmed is not recorded. The scale is pixels of the screen a millimetre: given,
//! or found by laying a bank card on the page. [`Screen`] is the page as a recorder without
//! samples, so that the manifest states what was shown.

mod images;
mod screen;
mod serve;
mod state;

pub use images::{ImageList, StimulusImage};
pub use screen::Screen;
pub use state::{Shown, StimulusState};

use evrig_session::rig::TargetDescription;
use serve::PageServer;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;

/// Why the target cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum StimulusError {
    /// The list of images is wrong.
    #[error("{}: {what}", path.display())]
    List {
        /// The list, or the image in it.
        path: PathBuf,
        /// Where and what, and what to do.
        what: String,
    },
    /// The page can draw one tag only.
    #[error("the page draws tag36h11 number 0; the rig's target has {family} number {id}")]
    Tag {
        /// Its family.
        family: String,
        /// Its number.
        id: u32,
    },
    /// The address cannot be served.
    #[error("cannot serve the page at {address}: {source}; choose another port, or 0 for any")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Everyone on the network could turn the pages.
    #[error("{address} can be reached from outside; use 127.0.0.1, and `ssh -L` from elsewhere")]
    NotLoopback {
        /// Where it was to listen.
        address: SocketAddr,
    },
    /// No page confirmed the image.
    #[error(
        "no page confirmed image {index} ({label}) within {seconds} s; open {url} in a browser on \
         the screen, calibrate it, and press f for full screen"
    )]
    NotShown {
        /// Its place in the list.
        index: usize,
        /// Its label.
        label: String,
        /// How long was waited.
        seconds: u64,
        /// Where the page is.
        url: String,
    },
    /// The screen is too small for the target at its scale.
    #[error(
        "the screen shows {width_px:.0} x {height_px:.0} pixels and the target needs \
         {needed_px:.0} x {needed_height_px:.0} at {px_per_mm} a millimetre; use full screen or a \
         larger one"
    )]
    TooSmall {
        /// Width of the page.
        width_px: f64,
        /// Height of the page.
        height_px: f64,
        /// Width of the target.
        needed_px: f64,
        /// Height of the target.
        needed_height_px: f64,
        /// The scale.
        px_per_mm: f64,
    },
}

/// The page, served until it is dropped.
#[derive(Debug)]
pub struct Stimulus {
    address: SocketAddr,
    images: Arc<ImageList>,
    state: Arc<watch::Sender<StimulusState>>,
    runtime: tokio::runtime::Runtime,
}

impl Stimulus {
    /// Serves the page of a target at an address of the loopback interface. `px_per_mm` are the
    /// screen's own pixels; none asks the operator to calibrate.
    ///
    /// # Errors
    /// When the target has another tag, or the address is taken or not of this machine alone.
    pub fn serve(
        address: SocketAddr,
        target: &TargetDescription,
        images: ImageList,
        px_per_mm: Option<f64>,
    ) -> Result<Self, StimulusError> {
        if target.tag_family != "tag36h11" || target.tag_id != 0 {
            let (family, id) = (target.tag_family.clone(), target.tag_id);
            return Err(StimulusError::Tag { family, id });
        }
        if !address.ip().is_loopback() {
            return Err(StimulusError::NotLoopback { address });
        }
        let failed = |source| StimulusError::Listen { address, source };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("stimulus")
            .enable_all()
            .build()
            .map_err(failed)?;
        let listener = runtime.block_on(TcpListener::bind(address)).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let images = Arc::new(images);
        let (state, _) = watch::channel(StimulusState::new(px_per_mm));
        let state = Arc::new(state);
        let served = PageServer::new(address, target, Arc::clone(&images), Arc::clone(&state));
        runtime.spawn(serve::accept(listener, Arc::new(served)));
        Ok(Self { address, images, state, runtime })
    }

    /// Where the page is.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// What is shown.
    #[must_use]
    pub fn images(&self) -> &ImageList {
        &self.images
    }

    /// The current state.
    #[must_use]
    pub fn state(&self) -> StimulusState {
        self.state.borrow().clone()
    }

    /// Shows an image and waits until the page confirms that it is on the screen.
    ///
    /// # Errors
    /// When no page confirms in time, or the screen is too small.
    pub fn show(&self, index: usize, patience: Duration) -> Result<Shown, StimulusError> {
        let mut seen = self.state.subscribe();
        self.state.send_modify(|state| state.turn_to(index, true));
        let sequence = self.state.borrow().sequence;
        let shown = self.wait(patience, async {
            let is_it = |state: &StimulusState| {
                state.shown.as_ref().is_some_and(|shown| shown.sequence >= sequence)
            };
            seen.wait_for(is_it).await.ok().and_then(|state| state.shown.clone())
        });
        let Some(shown) = shown else {
            let label = self.images.get(index).map_or_else(String::new, |i| i.label.clone());
            let seconds = patience.as_secs();
            return Err(StimulusError::NotShown { index, label, seconds, url: self.url() });
        };
        if shown.fits {
            return Ok(shown);
        }
        Err(StimulusError::TooSmall {
            width_px: shown.width_px,
            height_px: shown.height_px,
            needed_px: shown.needed_px[0],
            needed_height_px: shown.needed_px[1],
            px_per_mm: shown.px_per_mm,
        })
    }

    /// Waits until a page is open, calibrated and not paused; false when it is not within
    /// `patience`.
    #[must_use]
    pub fn wait_until_ready(&self, patience: Duration) -> bool {
        let mut seen = self.state.subscribe();
        let ready = self.wait(patience, async {
            seen.wait_for(StimulusState::is_ready).await.ok().map(|_| ())
        });
        ready.is_some()
    }

    fn wait<T>(&self, patience: Duration, what: impl Future<Output = Option<T>>) -> Option<T> {
        self.runtime.block_on(async { tokio::time::timeout(patience, what).await.ok().flatten() })
    }
}
