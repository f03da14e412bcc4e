//! One connection of a host, from preamble to close.

use super::backlog::BacklogLimits;
use super::frame_stream::FrameStream;
use super::writer::{
    AgentStream, ConnectionError, HOST_READ_TIMEOUT, MessageWriter, SharedCamera, lock,
};
use crate::discipline::DisciplineReport;
use crate::order::{CaptureOrder, Delivery};
use crate::read_all_clocks;
use crate::source::{FrameSource, SourceError};
use crate::wire::{self, MAX_PROBE_BYTES, Message, MessageDecoder, PREAMBLE_BYTES, TakeTally};
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, ReadHalf};
use tokio::sync::Semaphore;

/// A host that has just left may still be seen as there: its successor waits so long.
const TURN_TIMEOUT: Duration = Duration::from_secs(1);
/// Bytes of filler in a message.
const FILLER_BYTES: usize = 1 << 20;

/// What all connections share: the camera, which one of them has.
pub(super) struct AgentState {
    camera: SharedCamera,
    limits: BacklogLimits,
    /// One permit: the camera's.
    turn: Semaphore,
}

/// Exchanges and checks the preambles.
pub(super) async fn exchange_preambles(
    line: &mut Box<dyn AgentStream>,
) -> Result<(), ConnectionError> {
    line.write_all(&wire::preamble()).await?;
    line.flush().await?;
    let mut preamble = [0; PREAMBLE_BYTES];
    line.read_exact(&mut preamble).await?;
    Ok(wire::check_preamble(&preamble)?)
}

impl AgentState {
    pub(super) fn new(camera: SharedCamera, limits: BacklogLimits) -> Self {
        Self { camera, limits, turn: Semaphore::new(1) }
    }

    pub(super) async fn converse(&self, line: Box<dyn AgentStream>) {
        let (mut reader, half) = tokio::io::split(line);
        let writer = Arc::new(MessageWriter { half: tokio::sync::Mutex::new(half) });
        let Ok(Ok(_turn)) = tokio::time::timeout(TURN_TIMEOUT, self.turn.acquire()).await else {
            let because = "another recorder uses this camera; end that recording first".to_owned();
            // A client that does not wait for the refusal needs none.
            let _ = writer.write(&Message::Refused { because }).await;
            return;
        };
        if let Err(lost) = self.answer(&mut reader, &writer).await {
            // The host may be gone, which is then the reason; else it learns it here.
            let _ = writer.write(&Message::Refused { because: lost.to_string() }).await;
        }
    }

    async fn answer(
        &self,
        reader: &mut ReadHalf<Box<dyn AgentStream>>,
        writer: &Arc<MessageWriter>,
    ) -> Result<(), ConnectionError> {
        let what = self.with_camera(|camera| camera.check()).await?;
        let camera = format!("{what}, evrig {}", env!("CARGO_PKG_VERSION"));
        writer.write(&Message::Hello { camera }).await?;
        let mut decoder = MessageDecoder::default();
        let mut buffer = vec![0; 4096];
        let mut delivery = Delivery::default();
        let mut take: Option<FrameStream> = None;
        loop {
            while let Some(message) = decoder.take()? {
                match message {
                    Message::Configure(_) | Message::Start | Message::Probe { .. }
                        if take.is_some() =>
                    {
                        // The camera and the line belong to the frames under way.
                        let because = "frames are flowing; stop them first".to_owned();
                        writer.write(&Message::Refused { because }).await?;
                    }
                    Message::Configure(order) => {
                        delivery = order.delivery;
                        writer.write(&self.configure(order).await?).await?;
                    }
                    Message::Start => {
                        let camera = Arc::clone(&self.camera);
                        take = Some(FrameStream::start(camera, delivery, &self.limits, writer)?);
                    }
                    Message::AskClock => writer.write(&Message::Clock(read_all_clocks())).await?,
                    Message::AskDiscipline => {
                        writer.write(&Message::Discipline(DisciplineReport::ask().await)).await?;
                    }
                    Message::Probe { n_bytes } => probe(writer, n_bytes).await?,
                    Message::Stop => {
                        let tally = match take.take() {
                            Some(take) => take.stop(writer).await?,
                            None => TakeTally::default(),
                        };
                        writer.write(&Message::Stopped(tally)).await?;
                    }
                    _ => {}
                }
            }
            let read = tokio::time::timeout(HOST_READ_TIMEOUT, reader.read(&mut buffer)).await;
            match read.map_err(|_| ConnectionError::Silent)?? {
                0 => return Ok(()),
                n => decoder.push(&buffer[..n]),
            }
        }
    }

    /// The camera's methods wait for hardware, so they run on a blocking thread.
    async fn with_camera<T: Send + 'static>(
        &self,
        what: impl FnOnce(&mut dyn FrameSource) -> Result<T, SourceError> + Send + 'static,
    ) -> Result<T, ConnectionError> {
        let camera = Arc::clone(&self.camera);
        let done = tokio::task::spawn_blocking(move || what(&mut **lock(&camera))).await;
        Ok(done.map_err(io::Error::from)??)
    }

    async fn configure(&self, order: CaptureOrder) -> Result<Message, ConnectionError> {
        self.with_camera(move |camera| {
            camera.set_focus(order.focus)?;
            let settings = camera.configure(&order.settings)?;
            Ok(Message::Configured { settings, description: camera.camera_description() })
        })
        .await
    }
}

async fn probe(writer: &MessageWriter, n_bytes: usize) -> Result<(), ConnectionError> {
    let mut left = n_bytes.min(MAX_PROBE_BYTES);
    while left > 0 {
        let n = left.min(FILLER_BYTES);
        writer.write(&Message::Filler(vec![0; n])).await?;
        left -= n;
    }
    Ok(())
}
