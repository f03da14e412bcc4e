//! Frames under way: one thread takes and codes them, one task sends them.

use super::backlog::{Backlog, BacklogLimits, Stored};
use super::writer::{ConnectionError, MessageWriter, SharedCamera, lock};
use crate::order::{Delivery, RgbDelivery};
use crate::source::{FrameSource, SourceError};
use crate::wire::{self, Message, TakeTally};
use evrig_core::pi_camera::PiFrame;
use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use tokio::task::JoinHandle as TaskHandle;

/// What the two have in common.
#[derive(Debug)]
struct Flow {
    live: Backlog,
    /// RGB images for after the take.
    late: Option<Backlog>,
    delivery: Delivery,
    is_ending: AtomicBool,
    failed: Mutex<Option<String>>,
    n_sent: AtomicU64,
    n_dropped: AtomicU64,
    n_spooled: AtomicU64,
    n_late: AtomicU64,
    n_late_dropped: AtomicU64,
}

/// A take. Dropped, it ends without sending what waits.
pub(super) struct FrameStream {
    flow: Arc<Flow>,
    taker: Option<JoinHandle<()>>,
    sender: Option<TaskHandle<Result<(), ConnectionError>>>,
}

impl FrameStream {
    pub(super) fn start(
        camera: SharedCamera,
        delivery: Delivery,
        limits: &BacklogLimits,
        writer: &Arc<MessageWriter>,
    ) -> io::Result<Self> {
        let late = match (delivery.rgb, &limits.spool) {
            (RgbDelivery::AfterTake, None) => {
                let because =
                    "RGB after the take needs a place for it; start `evrig pi` with --spool DIR";
                return Err(io::Error::other(because));
            }
            // All of them go to disk: memory belongs to what is live.
            (RgbDelivery::AfterTake, _) => {
                Some(BacklogLimits { memory_bytes: 0, ..limits.clone() })
            }
            _ => None,
        };
        let count = AtomicU64::default;
        let flow = Arc::new(Flow {
            live: Backlog::new(limits.clone())?,
            late: late.map(Backlog::new).transpose()?,
            delivery,
            is_ending: AtomicBool::new(false),
            failed: Mutex::default(),
            n_sent: count(),
            n_dropped: count(),
            n_spooled: count(),
            n_late: count(),
            n_late_dropped: count(),
        });
        let its = Arc::clone(&flow);
        let taker = std::thread::Builder::new().name("pi camera".to_owned()).spawn(move || {
            let mut camera = lock(&camera);
            if let Err(error) = take_all(&mut **camera, &its) {
                *lock(&its.failed) = Some(error.to_string());
            }
            camera.stop();
            its.live.close();
        })?;
        let (its, writer) = (Arc::clone(&flow), Arc::clone(writer));
        let sender = tokio::spawn(async move {
            let sent = send_all(&its, &writer).await;
            if sent.is_err() {
                its.is_ending.store(true, Ordering::Relaxed);
            }
            sent
        });
        Ok(Self { flow, taker: Some(taker), sender: Some(sender) })
    }

    /// Takes no more frames, sends those that wait, then the late images, and counts.
    pub(super) async fn stop(
        mut self,
        writer: &MessageWriter,
    ) -> Result<TakeTally, ConnectionError> {
        self.flow.is_ending.store(true, Ordering::Relaxed);
        if let Some(taker) = self.taker.take() {
            // A panic there was reported by its own hook.
            let _ = tokio::task::spawn_blocking(move || taker.join()).await;
        }
        let (mut n_messages, mut n_bytes) = self.flow.live.waiting();
        if let Some(late) = &self.flow.late {
            let (n, bytes) = late.waiting();
            (n_messages, n_bytes) = (n_messages + n, n_bytes + bytes);
        }
        writer.write(&Message::Draining { n_messages, n_bytes }).await?;
        if let Some(sender) = self.sender.take() {
            sender.await.map_err(io::Error::from)??;
        }
        if let Some(late) = &self.flow.late {
            late.close();
            while let Some(message) = late.next().await? {
                writer.send(&message).await?;
            }
        }
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Ok(TakeTally {
            n_sent: count(&self.flow.n_sent),
            n_dropped: count(&self.flow.n_dropped),
            n_spooled: count(&self.flow.n_spooled),
            n_late: count(&self.flow.n_late),
            n_late_dropped: count(&self.flow.n_late_dropped),
        })
    }
}

impl Drop for FrameStream {
    fn drop(&mut self) {
        self.flow.is_ending.store(true, Ordering::Relaxed);
        self.flow.live.close();
        if let Some(sender) = &self.sender {
            sender.abort();
        }
    }
}

async fn send_all(flow: &Flow, writer: &MessageWriter) -> Result<(), ConnectionError> {
    while let Some(message) = flow.live.next().await? {
        writer.send(&message).await?;
        flow.n_sent.fetch_add(1, Ordering::Relaxed);
    }
    let failed = lock(&flow.failed).take();
    match failed {
        Some(because) => writer.write(&Message::Refused { because }).await,
        None => Ok(()),
    }
}

fn take_all(camera: &mut dyn FrameSource, flow: &Flow) -> Result<(), SourceError> {
    camera.start()?;
    while !flow.is_ending.load(Ordering::Relaxed) {
        if let Some(frame) = camera.next()? {
            keep(frame, flow)?;
        }
    }
    Ok(())
}

/// Codes a frame and puts it where its parts belong.
fn keep(mut frame: PiFrame, flow: &Flow) -> Result<(), SourceError> {
    frame.metadata.n_dropped = flow.n_dropped.load(Ordering::Relaxed);
    let failed = |because: String| SourceError { because };
    let coding = flow.delivery.coding;
    let encoded = |frame: &PiFrame, is_late| {
        wire::encode_frame(frame, coding, is_late).map_err(|error| failed(error.to_string()))
    };
    let add = |counter: &AtomicU64| counter.fetch_add(1, Ordering::Relaxed);
    let late = match flow.delivery.rgb {
        RgbDelivery::Live => None,
        RgbDelivery::Every(n) => {
            if !frame.metadata.sequence.is_multiple_of(u64::from(n.max(1))) {
                frame.rgb = None;
            }
            None
        }
        RgbDelivery::AfterTake => {
            let coded = encoded(&frame, true)?;
            frame.rgb.take().map(|_| coded)
        }
    };
    let disk = |error: io::Error| failed(format!("the spool: {error}"));
    match flow.live.push(encoded(&frame, false)?).map_err(disk)? {
        Stored::Memory => {}
        Stored::Disk => _ = add(&flow.n_spooled),
        Stored::Nowhere => {
            // Without its metadata a late image would have no time.
            add(&flow.n_dropped);
            return Ok(());
        }
    }
    if let (Some(backlog), Some(coded)) = (&flow.late, late) {
        match backlog.push(coded).map_err(disk)? {
            Stored::Nowhere => add(&flow.n_late_dropped),
            Stored::Memory | Stored::Disk => add(&flow.n_late),
        };
    }
    Ok(())
}
