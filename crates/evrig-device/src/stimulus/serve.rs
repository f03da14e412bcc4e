//! The page's server: one connection a request, bounded in number, size and time.

use super::request::{self, Request};
use super::{ImageList, Shown, StimulusState};
use evrig_session::rig::TargetDescription;
use evrig_session::rig::tag;
use serde::Deserialize;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};

const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");
/// Connections at a time; a page needs three.
const MAX_CONNECTIONS: usize = 32;
/// For a request to be whole.
const REQUEST: Duration = Duration::from_secs(10);
/// A page that waits for news is answered so often at least.
const NEWS: Duration = Duration::from_secs(20);
/// For an answer to be taken.
const ANSWER: Duration = Duration::from_secs(30);
/// The page may load from here and do nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; \
    img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What is served.
#[derive(Debug)]
pub(super) struct Served {
    /// Names under which a browser may ask; another one is a page from elsewhere that was led here.
    hosts: [String; 2],
    target: Value,
    images: Arc<ImageList>,
    state: Arc<watch::Sender<StimulusState>>,
}

struct Answer {
    status: u16,
    media_type: &'static str,
    body: Vec<u8>,
}

impl Answer {
    fn status(status: u16) -> Self {
        Self { status, media_type: "text/plain", body: Vec::new() }
    }

    fn text(media_type: &'static str, text: &str) -> Self {
        Self { status: 200, media_type, body: text.as_bytes().to_vec() }
    }
}

#[derive(Deserialize)]
struct Step {
    by: i64,
}

#[derive(Deserialize)]
struct Pause {
    is_paused: bool,
}

#[derive(Deserialize)]
struct Scale {
    px_per_mm: f64,
}

impl Served {
    pub(super) fn new(
        address: SocketAddr,
        target: &TargetDescription,
        images: Arc<ImageList>,
        state: Arc<watch::Sender<StimulusState>>,
    ) -> Self {
        let centre = |i: usize| (i as f64 + 0.5) / tag::CELLS_PER_SIDE as f64;
        let row = |y: usize| -> String {
            let is_white = |x: usize| tag::is_white(centre(x), centre(y));
            (0..tag::CELLS_PER_SIDE).map(|x| if is_white(x) { '1' } else { '0' }).collect()
        };
        let target = json!({
            "picture_mm": target.picture_side.0, "gap_mm": target.gap.0,
            "tag_mm": target.tag_side.0, "cells": (0..tag::CELLS_PER_SIDE).map(row).collect::<Vec<_>>(),
        });
        let hosts = [address.to_string(), format!("localhost:{}", address.port())];
        Self { hosts, target, images, state }
    }

    async fn answer(&self, request: &Request) -> Answer {
        let host = request.header("host").unwrap_or_default();
        if !self.hosts.iter().any(|known| known == host) {
            return Answer::status(403);
        }
        let (path, query) = request.target.split_once('?').unwrap_or((&request.target, ""));
        match (request.method.as_str(), path) {
            ("GET", "/") => Answer::text("text/html; charset=utf-8", PAGE),
            ("GET", "/page.js") => Answer::text("text/javascript; charset=utf-8", SCRIPT),
            ("GET", "/state") => self.news(query).await,
            ("GET", path) => match path.strip_prefix("/image/").map(str::parse) {
                Some(Ok(index)) => self.image(index).await,
                _ => Answer::status(404),
            },
            // Only this page's own script can send this header without being asked first.
            ("POST", path) if request.header("x-evrig") == Some("stimulus") => {
                Answer::status(if self.take(path, &request.body) { 204 } else { 400 })
            }
            ("POST", _) => Answer::status(403),
            _ => Answer::status(405),
        }
    }

    /// The state, once it is newer than what the page knows or after a while.
    async fn news(&self, query: &str) -> Answer {
        let known = query.strip_prefix("after=").and_then(|known| known.parse().ok()).unwrap_or(0);
        let mut seen = self.state.subscribe();
        self.state.send_if_modified(|state| !std::mem::replace(&mut state.is_open, true));
        let is_new = |state: &StimulusState| state.sequence > known;
        let _ = tokio::time::timeout(NEWS, seen.wait_for(is_new)).await;
        let state = self.state.borrow().clone();
        let image = self.images.get(state.index);
        let value = json!({
            "state": state, "target": self.target, "n": self.images.as_slice().len(),
            "label": image.map_or("", |image| &image.label),
        });
        Answer::text("application/json", &value.to_string())
    }

    async fn image(&self, index: usize) -> Answer {
        let Some(image) = self.images.get(index) else { return Answer::status(404) };
        match tokio::fs::read(&image.path).await {
            Ok(body) => Answer { status: 200, media_type: image.media_type, body },
            Err(_) => Answer::status(404),
        }
    }

    /// What the page says; false when it cannot be.
    fn take(&self, path: &str, body: &[u8]) -> bool {
        let n_images = self.images.as_slice().len();
        match path {
            "/shown" => {
                let Ok(shown) = serde_json::from_slice::<Shown>(body) else { return false };
                let current = self.state.borrow().clone();
                let is_current = shown.sequence <= current.sequence && shown.index == current.index;
                self.state.send_if_modified(|state| {
                    if is_current {
                        state.shown = Some(shown);
                    }
                    is_current
                });
                true
            }
            "/step" => serde_json::from_slice::<Step>(body)
                .map(|step| self.state.send_modify(|state| state.step(step.by, n_images)))
                .is_ok(),
            "/pause" => serde_json::from_slice::<Pause>(body)
                .map(|pause| self.state.send_modify(|state| state.pause(pause.is_paused)))
                .is_ok(),
            "/scale" => serde_json::from_slice::<Scale>(body).is_ok_and(|scale| {
                self.state.send_if_modified(|state| state.calibrate(scale.px_per_mm))
            }),
            _ => false,
        }
    }
}

/// Answers whoever comes, until the runtime ends.
pub(super) async fn accept(listener: TcpListener, served: Arc<Served>) {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let Ok(place) = Arc::clone(&places).acquire_owned().await else { return };
        // A client that is gone before it was served is none.
        let Ok((socket, _)) = listener.accept().await else { continue };
        let served = Arc::clone(&served);
        tokio::spawn(async move {
            converse(socket, &served).await;
            drop(place);
        });
    }
}

async fn converse(mut socket: impl AsyncRead + AsyncWrite + Unpin, served: &Served) {
    let answer = match tokio::time::timeout(REQUEST, request::read(&mut socket)).await {
        Ok(Ok(request)) => served.answer(&request).await,
        Ok(Err(status)) => Answer::status(status),
        Err(_) => Answer::status(408),
    };
    let head = format!(
        "HTTP/1.1 {} {}\r\nContent-Type: {}\r\nContent-Length: {}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
         Content-Security-Policy: {POLICY}\r\n\r\n",
        answer.status,
        if answer.status < 300 { "OK" } else { "Refused" },
        answer.media_type,
        answer.body.len(),
    );
    let write = async {
        socket.write_all(head.as_bytes()).await?;
        socket.write_all(&answer.body).await?;
        socket.shutdown().await
    };
    // A page that was closed takes no answer.
    let _ = tokio::time::timeout(ANSWER, write).await;
}
