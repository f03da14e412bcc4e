//! One host, from its first word to its last.

use super::backlog::Room;
use super::take::Take;
use super::{Stream, lock};
use crate::discipline::Discipline;
use crate::order::{Delivery, Order};
use crate::read_all_clocks;
use crate::source::{FrameSource, SourceError};
use crate::wire::{self, Decoder, MAX_PROBE_BYTES, Message, PREAMBLE_BYTES, TakeTally, WireError};
use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::sync::Semaphore;

/// A host asks for the clock every second: one that is silent for so long is gone.
const HOST_SILENCE: Duration = Duration::from_secs(10);
/// How long the host may take no byte.
const HOST_BUSY: Duration = Duration::from_secs(10);
/// A host that has just left may still be seen as there: its successor waits so long.
const HANDING_OVER: Duration = Duration::from_secs(1);
/// Bytes of filler in a message.
const FILLER_BYTES: usize = 1 << 20;

pub(super) type Camera = Arc<Mutex<Box<dyn FrameSource>>>;

/// Why a connection ended early.
#[derive(Debug, thiserror::Error)]
pub(super) enum Lost {
    #[error(transparent)]
    Wire(#[from] WireError),
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error("the host was silent for {HOST_SILENCE:?}")]
    Silent,
    #[error("the host took no byte for {HOST_BUSY:?}")]
    Busy,
}

/// What all connections share: the camera, which one of them has.
pub(super) struct Shared {
    camera: Camera,
    room: Room,
    /// One permit: the camera's.
    turn: Semaphore,
}

/// The half of a connection that frames and answers go through.
pub(super) struct Speaker {
    half: tokio::sync::Mutex<WriteHalf<Box<dyn Stream>>>,
}

impl Speaker {
    pub(super) async fn send(&self, bytes: &[u8]) -> Result<(), Lost> {
        let mut half = self.half.lock().await;
        // Piece by piece, so that a slow host has as long for each, not for a frame.
        for piece in bytes.chunks(1 << 16) {
            tokio::time::timeout(HOST_BUSY, half.write_all(piece))
                .await
                .map_err(|_| Lost::Busy)??;
        }
        tokio::time::timeout(HOST_BUSY, half.flush()).await.map_err(|_| Lost::Busy)??;
        Ok(())
    }

    pub(super) async fn say(&self, message: &Message) -> Result<(), Lost> {
        self.send(&wire::encode(message)).await
    }
}

/// Sends our first bytes and looks at the other side's.
pub(super) async fn exchange_preambles(line: &mut Box<dyn Stream>) -> Result<(), Lost> {
    line.write_all(&wire::preamble()).await?;
    line.flush().await?;
    let mut preamble = [0; PREAMBLE_BYTES];
    line.read_exact(&mut preamble).await?;
    Ok(wire::check_preamble(&preamble)?)
}

impl Shared {
    pub(super) fn new(camera: Camera, room: Room) -> Self {
        Self { camera, room, turn: Semaphore::new(1) }
    }

    pub(super) async fn converse(&self, line: Box<dyn Stream>) {
        let (mut ear, half) = tokio::io::split(line);
        let mouth = Arc::new(Speaker { half: tokio::sync::Mutex::new(half) });
        let Ok(Ok(_turn)) = tokio::time::timeout(HANDING_OVER, self.turn.acquire()).await else {
            let because = "another recorder uses this camera; end that recording first".to_owned();
            // A client that does not wait for the refusal needs none.
            let _ = mouth.say(&Message::Refused { because }).await;
            return;
        };
        if let Err(lost) = self.answer(&mut ear, &mouth).await {
            // The host may be gone, which is then the reason; else it learns it here.
            let _ = mouth.say(&Message::Refused { because: lost.to_string() }).await;
        }
    }

    async fn answer(
        &self,
        ear: &mut ReadHalf<Box<dyn Stream>>,
        mouth: &Arc<Speaker>,
    ) -> Result<(), Lost> {
        let what = self.with_camera(|camera| camera.check()).await?;
        let camera = format!("{what}, evrig {}", env!("CARGO_PKG_VERSION"));
        mouth.say(&Message::Hello { camera }).await?;
        let mut decoder = Decoder::default();
        let mut buffer = vec![0; 4096];
        let mut delivery = Delivery::default();
        let mut take: Option<Take> = None;
        loop {
            while let Some(message) = decoder.take()? {
                match message {
                    Message::Configure(_) | Message::Start | Message::Probe { .. }
                        if take.is_some() =>
                    {
                        // The camera and the line belong to the frames under way.
                        let because = "frames are flowing; stop them first".to_owned();
                        mouth.say(&Message::Refused { because }).await?;
                    }
                    Message::Configure(order) => {
                        delivery = order.delivery;
                        mouth.say(&self.configure(order).await?).await?;
                    }
                    Message::Start => {
                        let camera = Arc::clone(&self.camera);
                        take = Some(Take::start(camera, delivery, &self.room, mouth)?);
                    }
                    Message::AskClock => mouth.say(&Message::Clock(read_all_clocks())).await?,
                    Message::AskDiscipline => {
                        mouth.say(&Message::Discipline(Discipline::ask().await)).await?;
                    }
                    Message::Probe { n_bytes } => probe(mouth, n_bytes).await?,
                    Message::Stop => {
                        let tally = match take.take() {
                            Some(take) => take.stop(mouth).await?,
                            None => TakeTally::default(),
                        };
                        mouth.say(&Message::Stopped(tally)).await?;
                    }
                    _ => {}
                }
            }
            let read = tokio::time::timeout(HOST_SILENCE, ear.read(&mut buffer)).await;
            match read.map_err(|_| Lost::Silent)?? {
                0 => return Ok(()),
                n => decoder.push(&buffer[..n]),
            }
        }
    }

    /// The camera's verbs wait for hardware, so they run where waiting holds nobody up.
    async fn with_camera<T: Send + 'static>(
        &self,
        what: impl FnOnce(&mut dyn FrameSource) -> Result<T, SourceError> + Send + 'static,
    ) -> Result<T, Lost> {
        let camera = Arc::clone(&self.camera);
        let done = tokio::task::spawn_blocking(move || what(&mut **lock(&camera))).await;
        Ok(done.map_err(io::Error::from)??)
    }

    async fn configure(&self, order: Order) -> Result<Message, Lost> {
        self.with_camera(move |camera| {
            camera.set_focus(order.focus)?;
            let settings = camera.configure(&order.settings)?;
            Ok(Message::Configured { settings, says: camera.says() })
        })
        .await
    }
}

async fn probe(mouth: &Speaker, n_bytes: usize) -> Result<(), Lost> {
    let mut left = n_bytes.min(MAX_PROBE_BYTES);
    while left > 0 {
        let n = left.min(FILLER_BYTES);
        mouth.say(&Message::Filler(vec![0; n])).await?;
        left -= n;
    }
    Ok(())
}
