//! The content of the live view, gathered from samples.

use super::{LiveError, LiveStatus};
use evrig_core::event::EventSlice;
use evrig_core::frame::Frame;
use evrig_core::geometry::Size;
use evrig_core::time::{Davis, HostMonotonic, Span, Stamp};
use evrig_format::aedat4::Content;
use evrig_reconstruct::roi::{SampleFormat, SingleFrameDetector};
use evrig_record::host_clock;
use evrig_record::recorder::RecorderSample;
use evrig_session::HostTime;
use evrig_session::rig::Pose;

/// Between two searches for the tag: five a second cost little of a core.
const BETWEEN_LOOKS: Span = Span::from_micros(200_000);

/// Events of a short time as an image: blue where it grew brighter, red where darker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventImage {
    /// Columns and rows.
    pub size: Size,
    /// Red, green, blue; rows without padding.
    pub rgb: Vec<u8>,
}

/// Rates, the event image, and where the tag is.
#[derive(Debug)]
pub struct LiveView {
    size: Size,
    /// On minus Off events of each pixel.
    balance: Vec<i16>,
    spotter: SingleFrameDetector,
    looked: Option<Stamp<HostMonotonic>>,
    tag_px: Option<[[f64; 2]; 4]>,
    began: Option<Stamp<HostMonotonic>>,
    counts: Counts,
    clock: Option<[f64; 2]>,
}

#[derive(Debug, Default)]
struct Counts {
    n_events: u64,
    n_on: u64,
    n_davis_frames: u64,
    n_pi_frames: u64,
    longest_delay: Span,
}

impl LiveView {
    pub(super) fn new(size: Size, (family, id): (&str, u32)) -> Result<Self, LiveError> {
        let spotter = SingleFrameDetector::new(family, id, SampleFormat::Brightness);
        Ok(Self {
            size,
            balance: vec![0; size.n_pixels()],
            spotter: spotter.ok_or_else(|| LiveError::Tag { family: family.to_owned() })?,
            looked: None,
            tag_px: None,
            began: None,
            counts: Counts::default(),
            clock: None,
        })
    }

    /// Counts a sample.
    pub(super) fn take(&mut self, sample: &RecorderSample) {
        match sample {
            RecorderSample::Packet { content, arrived, .. } => {
                self.see_delay(*arrived);
                match content {
                    Content::Events(events) => self.see_events(events.as_slice()),
                    Content::Frame(_) => self.counts.n_davis_frames += 1,
                    _ => {}
                }
            }
            RecorderSample::Frame { arrived, .. } => {
                self.see_delay(*arrived);
                self.counts.n_pi_frames += 1;
            }
            RecorderSample::Clock(exchange) => {
                let round = (exchange.answered.monotonic - exchange.asked.monotonic).as_nanos();
                let middle = exchange.asked.unix + Span::from_nanos(round / 2);
                let offset = (exchange.pi.realtime - middle).as_nanos();
                self.clock = Some([offset as f64 * 1e-3, round as f64 * 0.5e-3]);
            }
            // An image that comes after the take, and remarks for the log, are nothing to look at.
            RecorderSample::LateRgb { .. } | RecorderSample::Note { .. } => {}
        }
    }

    fn see_delay(&mut self, arrived: HostTime) {
        let delay = host_clock::now() - arrived.monotonic;
        self.counts.longest_delay = self.counts.longest_delay.max(delay);
    }

    fn see_events(&mut self, events: EventSlice<'_>) {
        self.counts.n_events += events.len() as u64;
        self.counts.n_on += events.count_on() as u64;
        let width = usize::from(self.size.width);
        for event in events.iter().filter(|event| self.size.contains(event.x, event.y)) {
            let pixel = &mut self.balance[usize::from(event.y) * width + usize::from(event.x)];
            *pixel = pixel.saturating_add(if event.on { 1 } else { -1 });
        }
    }

    /// Looks for the tag, if the last look is long enough ago; where it was last seen to be.
    pub(super) fn look(&mut self, frame: &Frame<Davis>) -> Option<[[f64; 2]; 4]> {
        let now = host_clock::now();
        if self.looked.is_none_or(|looked| now - looked >= BETWEEN_LOOKS) {
            self.looked = Some(now);
            self.tag_px = self.spotter.search(frame);
        }
        self.tag_px
    }

    /// The events since the last call.
    pub(super) fn take_events(&mut self) -> EventImage {
        let colour = |balance: &mut i16| match std::mem::take(balance) {
            0 => [255, 255, 255],
            1.. => [30, 80, 220],
            _ => [220, 50, 40],
        };
        let rgb = self.balance.iter_mut().flat_map(colour).collect();
        EventImage { size: self.size, rgb }
    }

    /// Rates since the last call.
    pub(super) fn status(
        &mut self,
        now: HostTime,
        pose: Option<Pose>,
        n_dropped_by_devices: u64,
        n_dropped_for_viewers: u64,
    ) -> LiveStatus {
        let began = self.began.replace(now.monotonic).unwrap_or(now.monotonic);
        let seconds = (now.monotonic - began).as_secs_f64();
        let counts = std::mem::take(&mut self.counts);
        let rate = |n: u64| if seconds > 0.0 { n as f64 / seconds } else { 0.0 };
        let on_share = counts.n_on as f64 / counts.n_events as f64;
        LiveStatus {
            events_per_s: rate(counts.n_events),
            on_share: (counts.n_events > 0).then_some(on_share),
            davis_frames_per_s: rate(counts.n_davis_frames),
            pi_frames_per_s: rate(counts.n_pi_frames),
            n_dropped_by_devices,
            n_dropped_for_viewers,
            longest_delay_ms: counts.longest_delay.as_secs_f64() * 1e3,
            tag_px: self.tag_px,
            pi_clock_offset_us: self.clock.map(|[offset, _]| offset),
            pi_clock_error_us: self.clock.map(|[_, error]| error),
            pose: pose.map(|pose| {
                let [x, y, z] = pose.position_mm();
                [x, y, z, pose.r.0]
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};
    use evrig_core::pi_camera::ClockSandwich;
    use evrig_session::ClockExchange;

    fn at(ms: i64) -> HostTime {
        HostTime { monotonic: Stamp::from_micros(ms * 1_000), unix: Stamp::from_micros(ms * 1_000) }
    }

    fn view() -> LiveView {
        LiveView::new(Size::new(4, 2), ("tag36h11", 0)).unwrap()
    }

    fn packet(events: &[(u16, u16, bool)]) -> RecorderSample {
        let events: Events = events.iter().map(|&(x, y, on)| Event { t: 0, x, y, on }).collect();
        RecorderSample::Packet { stream: 0, arrived: at(0), content: Content::Events(events) }
    }

    #[test]
    fn rates_are_counts_over_the_time_between_two_calls() {
        let mut view = view();
        view.status(at(1_000), None, 0, 0);
        view.take(&packet(&[(0, 0, true), (1, 0, true), (2, 0, false), (9, 9, true)]));
        let status = view.status(at(3_000), None, 5, 7);
        assert_eq!((status.events_per_s, status.on_share), (2.0, Some(0.75)));
        assert_eq!((status.n_dropped_by_devices, status.n_dropped_for_viewers), (5, 7));
        assert_eq!(view.status(at(4_000), None, 5, 7).events_per_s, 0.0);
    }

    #[test]
    fn the_image_shows_the_sign_of_each_pixels_events_once() {
        let mut view = view();
        view.take(&packet(&[(0, 0, true), (3, 1, false), (1, 0, true), (1, 0, false)]));
        let image = view.take_events();
        assert_eq!(image.rgb[..3], [30, 80, 220]);
        assert_eq!(image.rgb[3..6], [255; 3]);
        assert_eq!(image.rgb[21..], [220, 50, 40]);
        assert!(view.take_events().rgb.iter().all(|value| *value == 255));
    }

    #[test]
    fn the_clock_offset_is_taken_at_the_middle_of_the_exchange() {
        let mut view = view();
        let pi = ClockSandwich {
            boottime_before: Stamp::from_micros(0),
            realtime: Stamp::from_micros(1_250_000),
            boottime_after: Stamp::from_micros(0),
        };
        view.take(&RecorderSample::Clock(ClockExchange {
            asked: at(1_000),
            pi,
            pi_raw: None,
            answered: at(1_100),
        }));
        let status = view.status(at(2_000), None, 0, 0);
        assert_eq!(status.pi_clock_offset_us, Some(200_000.0));
        assert_eq!(status.pi_clock_error_us, Some(50_000.0));
    }

    #[test]
    fn a_family_that_nobody_knows_is_reported() {
        let message = LiveView::new(Size::new(4, 2), ("tag1", 0)).unwrap_err().to_string();
        assert!(message.contains("tag1"), "{message}");
    }
}
