//! What every part of the agent uses of a connection and of the camera.

use crate::source::{FrameSource, SourceError};
use crate::wire::{self, Message, WireError};
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncWriteExt, WriteHalf};

/// A host asks for the clock every second: one that is silent for so long is gone.
pub(super) const HOST_READ_TIMEOUT: Duration = Duration::from_secs(10);
/// How long the host may take no byte.
const HOST_WRITE_TIMEOUT: Duration = Duration::from_secs(10);

pub(super) type SharedCamera = Arc<Mutex<Box<dyn FrameSource>>>;

/// Why a connection ended early.
#[derive(Debug, thiserror::Error)]
pub(super) enum ConnectionError {
    #[error(transparent)]
    Wire(#[from] WireError),
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error("the host was silent for {HOST_READ_TIMEOUT:?}")]
    Silent,
    #[error("the host took no byte for {HOST_WRITE_TIMEOUT:?}")]
    Busy,
}

/// Either kind of line.
pub(super) trait AgentStream:
    tokio::io::AsyncRead + tokio::io::AsyncWrite + Send + Unpin
{
}
impl<T: tokio::io::AsyncRead + tokio::io::AsyncWrite + Send + Unpin> AgentStream for T {}

/// The half of a connection that frames and answers go through.
pub(super) struct MessageWriter {
    pub(super) half: tokio::sync::Mutex<WriteHalf<Box<dyn AgentStream>>>,
}

impl MessageWriter {
    pub(super) async fn send(&self, bytes: &[u8]) -> Result<(), ConnectionError> {
        let mut half = self.half.lock().await;
        // Piece by piece, so that a slow host has as long for each, not for a frame.
        for piece in bytes.chunks(1 << 16) {
            tokio::time::timeout(HOST_WRITE_TIMEOUT, half.write_all(piece))
                .await
                .map_err(|_| ConnectionError::Busy)??;
        }
        tokio::time::timeout(HOST_WRITE_TIMEOUT, half.flush())
            .await
            .map_err(|_| ConnectionError::Busy)??;
        Ok(())
    }

    pub(super) async fn write(&self, message: &Message) -> Result<(), ConnectionError> {
        self.send(&wire::encode(message)).await
    }
}

pub(super) fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is locked here is whole between any two statements.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
