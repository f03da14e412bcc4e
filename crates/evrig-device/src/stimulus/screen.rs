//! The screen as a recorder: it gives no samples; its manifest entry states what it showed.

use super::Stimulus;
use evrig_record::Finding;
use evrig_record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderTally, SampleSender,
};
use evrig_session::sha256_of_file;
use serde_json::json;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// For a page to confirm an image.
const PATIENCE: Duration = Duration::from_secs(30);

/// The screen, showing one image of the list for each recording.
#[derive(Debug)]
pub struct Screen {
    stimulus: Arc<Stimulus>,
    /// The image of the next recording.
    next: Arc<AtomicUsize>,
    /// Held while it records, or its writer would end.
    outlet: Option<SampleSender>,
}

impl Screen {
    /// The screen of a page; the caller sets the image in `next` before each recording.
    #[must_use]
    pub fn new(stimulus: Arc<Stimulus>, next: Arc<AtomicUsize>) -> Self {
        Self { stimulus, next, outlet: None }
    }

    fn failed(&self, because: impl ToString) -> RecorderError {
        RecorderError {
            device: format!("stimulus at {}", self.stimulus.url()),
            because: because.to_string(),
            remedy: "look at the page on the target's screen",
        }
    }
}

impl Recorder for Screen {
    fn name(&self) -> &'static str {
        "stimulus"
    }

    fn check(&mut self) -> Vec<Finding> {
        let state = self.stimulus.state();
        let url = self.stimulus.url();
        vec![match (state.is_open, state.px_per_mm) {
            (true, Some(scale)) => {
                Finding::good("stimulus", format!("{url} is open, {scale:.3} pixels a millimetre"))
            }
            (true, None) => Finding::bad("stimulus", format!("{url} is not calibrated; press c")),
            (false, _) => Finding::bad("stimulus", format!("open {url} on the target's screen")),
        }]
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        let index = self.next.load(Ordering::SeqCst);
        let image = self.stimulus.images().get(index).cloned();
        let image = image.ok_or_else(|| self.failed(format!("the list has no image {index}")))?;
        let (sha256, bytes) = sha256_of_file(&image.path).map_err(|error| self.failed(error))?;
        let shown = self.stimulus.show(index, PATIENCE).map_err(|error| self.failed(error))?;
        let file = image.path.file_name().map(|name| name.to_string_lossy().into_owned());
        let description = json!({
            "label": image.label, "image": file, "sha256": sha256, "bytes": bytes,
            "index": index, "shown": shown,
        });
        Ok(PreparedRecorder { description, streams: Vec::new() })
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        self.outlet = Some(outlet);
        Ok(())
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        Ok(RecorderTally::default())
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.outlet = None;
        Ok(RecorderTally::default())
    }

    fn abort(&mut self) {
        self.outlet = None;
    }
}
