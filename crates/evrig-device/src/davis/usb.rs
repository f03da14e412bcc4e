//! A DAVIS346 on USB, through the crate `neuromorphic-drivers` (libusb).
//!
//! Set before anything flows: biases, exposure, frame rate, APS on or off, and the camera's own
//! filters off, so that every event it makes is recorded. What the registers then hold is read
//! back. Stamps in the file are the camera's microseconds plus one constant, `unix_minus_device_us`
//! in the manifest, taken once from the first packet's arrival; nothing is corrected, so the
//! camera's drift stays in the data and the arrivals in the log show it.

mod convert;
mod registers;
mod settings;

use super::streams::describe;
use convert::Converter;
use evrig_core::geometry::Size;
use evrig_core::time::Span;
use evrig_format::aedat4::StreamSpec;
use evrig_record::Finding;
use evrig_record::recorder::{
    PreparedRecorder, Recorder, RecorderError, RecorderMonitor, RecorderSample, RecorderTally,
    SampleSender, host_time,
};
use evrig_session::HostTime;
use evrig_session::rig::DavisDescription;
use neuromorphic_drivers::inivation_davis346 as driver;
use neuromorphic_drivers::{Flag, GenericDevice, Identifier, UsbDevice, UsbOverflow};
use registers::{DavisRegisters, Opened};
use serde_json::json;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// For the first packet; a camera sends one a millisecond, even of a dark scene.
const FIRST_PACKET: Duration = Duration::from_secs(5);
/// For one packet while it runs.
const POLL: Duration = Duration::from_millis(50);
/// For what is still in the driver's buffers when a recording ends.
const DRAIN: Duration = Duration::from_millis(300);

type UsbFaults = Flag<driver::Error, UsbOverflow>;

/// The camera, open, with everything that its thread needs.
struct OpenCamera {
    device: driver::Device,
    faults: UsbFaults,
    converter: Converter,
    registers: Option<Opened>,
    has_frames: bool,
}

/// The first DAVIS346 on USB.
pub struct UsbDavis {
    description: DavisDescription,
    monitor: Arc<RecorderMonitor>,
    /// Where packets go; they are thrown away until a recording has begun.
    outlet: Arc<Mutex<Option<SampleSender>>>,
    thread: Option<JoinHandle<()>>,
}

impl UsbDavis {
    /// Will open the camera and set it as described.
    #[must_use]
    pub fn new(description: &DavisDescription) -> Self {
        Self {
            description: description.clone(),
            monitor: Arc::default(),
            outlet: Arc::default(),
            thread: None,
        }
    }

    fn stop(&mut self) {
        self.monitor.end();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own hook.
            let _ = thread.join();
        }
    }
}

impl Recorder for UsbDavis {
    fn name(&self) -> &'static str {
        "davis"
    }

    fn check(&mut self) -> Vec<Finding> {
        vec![match registers::find() {
            Ok(camera) => Finding::good("davis", format!("DAVIS346 {camera}")),
            Err(because) => Finding::bad("davis", failed(because).to_string()),
        }]
    }

    fn prepare(&mut self) -> Result<PreparedRecorder, RecorderError> {
        self.stop();
        self.monitor = Arc::default();
        let (mut camera, mut reported) = open(&self.description)?;
        let offset_us = wait_for_clock(&mut camera)?;
        reported["unix_minus_device_us"] = json!(offset_us);
        let streams = streams(&camera);
        let mut description = describe(&format!("usb {}", camera.device.serial()), &streams);
        description["camera"] = reported;
        let outlet = Arc::clone(&self.outlet);
        *outlet.lock().unwrap_or_else(PoisonError::into_inner) = None;
        let work = move |outlet: &Arc<Mutex<Option<SampleSender>>>, monitor: &RecorderMonitor| {
            run(camera, outlet, monitor)
        };
        let thread = self.monitor.spawn("davis", outlet, work);
        self.thread = Some(thread.map_err(failed)?);
        Ok(PreparedRecorder { description, streams })
    }

    fn start(&mut self, outlet: SampleSender) -> Result<(), RecorderError> {
        if self.thread.is_none() {
            return Err(failed("it was not prepared"));
        }
        *self.outlet.lock().unwrap_or_else(PoisonError::into_inner) = Some(outlet);
        if self.monitor.wait_for_first(FIRST_PACKET)? {
            return Ok(());
        }
        Err(failed(format!("no packet came within {FIRST_PACKET:?}")))
    }

    fn progress(&mut self) -> Result<RecorderTally, RecorderError> {
        self.monitor.progress()
    }

    fn finish(&mut self) -> Result<RecorderTally, RecorderError> {
        self.monitor.wait(DRAIN, |state| state.n_running > 0);
        self.stop();
        self.monitor.progress()
    }

    fn abort(&mut self) {
        self.stop();
    }
}

impl Drop for UsbDavis {
    fn drop(&mut self) {
        self.stop();
    }
}

fn failed(because: impl ToString) -> RecorderError {
    RecorderError {
        device: "davis on USB".to_owned(),
        because: because.to_string(),
        remedy: "plug in a DAVIS346 (USB 3), let this user have it (rig/99-evrig.rules), and close \
                 DV and other programs that hold it",
    }
}

/// Opens and sets the camera; returns what its registers read back.
fn open(description: &DavisDescription) -> Result<(OpenCamera, serde_json::Value), RecorderError> {
    let configuration = settings::configuration(description).map_err(failed)?;
    let faults: UsbFaults = Flag::new();
    let event_loop =
        neuromorphic_drivers::UsbEventLoop::new(Duration::from_millis(100), faults.clone());
    let device = driver::Device::open(
        Identifier::None,
        configuration.clone(),
        &driver::RING_CONFIGURATION,
        Arc::new(event_loop.map_err(failed)?),
        faults.clone(),
    )
    .map_err(failed)?;
    let registers = registers::open(device.bus_number(), device.address());
    let mut reported = json!({
        "serial": device.serial(),
        "asked": serde_json::to_value(&configuration).unwrap_or_default(),
        "frames": "8 bits of the converter's 10, as DV stores them",
    });
    let registers = match registers {
        Ok(registers) => {
            registers.set_frames(description.aps).map_err(failed)?;
            reported["read_back"] = registers.read_back().map_err(failed)?;
            Some(registers)
        }
        Err(because) if description.aps => {
            reported["read_back"] = json!(format!("not possible: {because}"));
            None
        }
        Err(because) => {
            return Err(failed(format!("its frames cannot be switched off: {because}")));
        }
    };
    let converter = Converter::new(device.create_adapter());
    let has_frames = description.aps;
    Ok((OpenCamera { device, faults, converter, registers, has_frames }, reported))
}

/// Waits for the first packet and takes the camera's clock from it, µs of Unix minus µs of the
/// camera.
fn wait_for_clock(camera: &mut OpenCamera) -> Result<i64, RecorderError> {
    let began = Instant::now();
    while began.elapsed() < FIRST_PACKET {
        camera.faults.load_error().map_err(failed)?;
        let Some(view) = camera.device.next_with_timeout(&POLL) else { continue };
        let arrived = arrival(host_time(), view.delay());
        camera.converter.take(view.slice);
        if let Some(offset_us) = camera.converter.set_clock(arrived.unix) {
            return Ok(offset_us);
        }
    }
    Err(failed(format!("it was set up, but no packet came within {FIRST_PACKET:?}")))
}

fn streams(camera: &OpenCamera) -> Vec<StreamSpec> {
    let source = format!("DAVIS346_{}", camera.device.serial());
    let mut streams = vec![StreamSpec::events(Size::DAVIS346, &source)];
    streams.extend(camera.has_frames.then(|| StreamSpec::frames(Size::DAVIS346, &source)));
    streams.push(StreamSpec::imu(&source));
    streams.push(StreamSpec::triggers(&source));
    streams
}

/// When something arrived that has waited in the driver since.
fn arrival(now: HostTime, delay: Duration) -> HostTime {
    let delay = Span::from_nanos(i64::try_from(delay.as_nanos()).unwrap_or(i64::MAX));
    HostTime { monotonic: now.monotonic - delay, unix: now.unix - delay }
}

/// Takes packets until the recording ends or the camera is gone.
fn run(
    mut camera: OpenCamera,
    outlet: &Mutex<Option<SampleSender>>,
    monitor: &RecorderMonitor,
) -> Result<(), RecorderError> {
    let mut ended = Ok(());
    let [n_early, n_early_in_camera] = [camera.device.dropped_packets(), n_dropped_within(&camera)];
    while !monitor.is_ending() {
        if let Err(error) = camera.faults.load_error() {
            ended = Err(failed(format!("it was lost: {error}")));
            break;
        }
        let Some(view) = camera.device.next_with_timeout(&POLL) else { continue };
        let arrived = arrival(host_time(), view.delay());
        let batch = camera.converter.take(view.slice);
        drop(view);
        let outlet = outlet.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(outlet) = outlet.as_ref() else { continue };
        let n_resets = batch.n_resets;
        for (stream, content) in batch.contents(camera.has_frames) {
            monitor.offer(outlet, RecorderSample::Packet { stream, arrived, content });
        }
        if n_resets > 0 {
            let text = format!("the camera set its clock back {n_resets} times in one packet");
            monitor.change(|state| state.tally.gaps.push(text));
        }
    }
    let n_dropped = camera.device.dropped_packets().saturating_sub(n_early);
    let n_within = n_dropped_within(&camera).saturating_sub(n_early_in_camera);
    monitor.change(|state| {
        state.tally.n_dropped += n_dropped;
        if n_dropped > 0 {
            let text = format!("{n_dropped} USB packets dropped because the host was too slow");
            state.tally.gaps.push(text);
        }
        if n_within > 0 {
            let text = format!("{n_within} events dropped in the camera because USB was too slow");
            state.tally.gaps.push(text);
            state.tally.n_dropped += n_within;
        }
    });
    // Whoever waits for samples sees that no more come.
    *outlet.lock().unwrap_or_else(PoisonError::into_inner) = None;
    ended
}

/// Events that the camera dropped itself, where it counts them.
fn n_dropped_within(camera: &OpenCamera) -> u64 {
    camera.registers.as_ref().and_then(|registers| registers.n_dropped().ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_session::rig::Rig;

    #[test]
    fn without_a_camera_the_error_states_what_to_do() {
        let mut davis = UsbDavis::new(&Rig::simulated().unwrap().davis);
        if davis.check().iter().all(|finding| finding.verdict == evrig_record::Verdict::Good) {
            // A machine with a camera: what it can do is shown by a recording.
            return;
        }
        let message = davis.prepare().unwrap_err().to_string();
        assert!(
            message.contains("davis on USB") && message.contains("99-evrig.rules"),
            "{message}"
        );
        let (outlet, _inlet) = evrig_record::recorder::channel(1);
        assert!(davis.start(outlet).unwrap_err().to_string().contains("not prepared"));
        davis.abort();
    }
}
