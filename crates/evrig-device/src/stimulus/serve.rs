//! The page's server: one connection a request, bounded in number, size and time.

use super::{ImageList, Shown, StimulusState};
use evrig_session::rig::TargetDescription;
use evrig_session::rig::tag;
use http_body_util::{BodyExt, Collected, Full, LengthLimitError, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST};
use hyper::header::{HeaderName, HeaderValue, X_CONTENT_TYPE_OPTIONS};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use serde::Deserialize;
use serde_json::{Value, json};
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};

const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");
/// Connections at a time; a page needs three.
const MAX_CONNECTIONS: usize = 32;
/// A longer head is refused.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// A longer body is refused.
const MAX_BODY_BYTES: usize = 4 << 10;
/// For the head of a request to be complete, and for its body.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// A page that waits for a newer state is answered at least this often.
const STATE_TIMEOUT: Duration = Duration::from_secs(20);
/// For an answer to be taken.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(30);
/// The page may load from here and do nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; \
    img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors \
    'none'";
/// Set by the page's own script only: another page's request with it needs our consent first.
const SCRIPT_HEADER: HeaderName = HeaderName::from_static("x-evrig");

type Answer = Response<Full<Bytes>>;

fn answer(status: StatusCode, media_type: &'static str, body: impl Into<Bytes>) -> Answer {
    let mut response = Response::new(Full::new(body.into()));
    *response.status_mut() = status;
    response.headers_mut().extend(
        [
            (CONTENT_TYPE, media_type),
            (CACHE_CONTROL, "no-store"),
            (X_CONTENT_TYPE_OPTIONS, "nosniff"),
            (CONTENT_SECURITY_POLICY, POLICY),
        ]
        .map(|(name, value)| (name, HeaderValue::from_static(value))),
    );
    response
}

fn refusal(status: StatusCode) -> Answer {
    answer(status, "text/plain", Bytes::new())
}

/// What the page asks for.
#[derive(Debug)]
pub(super) struct PageServer {
    /// Names under which a browser may ask; another name is that of a foreign page (DNS rebinding).
    hosts: [String; 2],
    target: Value,
    images: Arc<ImageList>,
    state: Arc<watch::Sender<StimulusState>>,
}

#[derive(Deserialize)]
struct PageStep {
    by: i64,
}

#[derive(Deserialize)]
struct PagePause {
    is_paused: bool,
}

#[derive(Deserialize)]
struct PageScale {
    px_per_mm: f64,
}

impl PageServer {
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
            "image_mm": target.picture_side.0, "gap_mm": target.gap.0,
            "tag_mm": target.tag_side.0, "cells": (0..tag::CELLS_PER_SIDE).map(row).collect::<Vec<_>>(),
        });
        let hosts = [address.to_string(), format!("localhost:{}", address.port())];
        Self { hosts, target, images, state }
    }

    async fn answer(&self, request: Request<Incoming>) -> Answer {
        let header =
            |name: &HeaderName| request.headers().get(name).and_then(|it| it.to_str().ok());
        let host = header(&HOST).unwrap_or_default();
        if !self.hosts.iter().any(|known| known == host) {
            return refusal(StatusCode::FORBIDDEN);
        }
        let path = request.uri().path();
        match (request.method(), path) {
            (&Method::GET, "/") => answer(StatusCode::OK, "text/html; charset=utf-8", PAGE),
            (&Method::GET, "/page.js") => {
                answer(StatusCode::OK, "text/javascript; charset=utf-8", SCRIPT)
            }
            (&Method::GET, "/state") => self.state(request.uri().query().unwrap_or_default()).await,
            (&Method::GET, path) => match path.strip_prefix("/image/").map(str::parse) {
                Some(Ok(index)) => self.image(index).await,
                _ => refusal(StatusCode::NOT_FOUND),
            },
            (&Method::POST, _) if header(&SCRIPT_HEADER) == Some("stimulus") => {
                let path = path.to_owned();
                let body = Limited::new(request.into_body(), MAX_BODY_BYTES).collect();
                let body = tokio::time::timeout(REQUEST_TIMEOUT, body).await;
                refusal(match body.map(|body| body.map(Collected::to_bytes)) {
                    Ok(Ok(body)) if self.take(&path, &body) => StatusCode::NO_CONTENT,
                    Ok(Err(error)) if error.is::<LengthLimitError>() => {
                        StatusCode::PAYLOAD_TOO_LARGE
                    }
                    Ok(_) => StatusCode::BAD_REQUEST,
                    Err(_) => StatusCode::REQUEST_TIMEOUT,
                })
            }
            (&Method::POST, _) => refusal(StatusCode::FORBIDDEN),
            _ => refusal(StatusCode::METHOD_NOT_ALLOWED),
        }
    }

    /// The state, once it is newer than what the page knows or after [`STATE_TIMEOUT`].
    async fn state(&self, query: &str) -> Answer {
        let known = query.strip_prefix("after=").and_then(|known| known.parse().ok()).unwrap_or(0);
        let mut seen = self.state.subscribe();
        self.state.send_if_modified(|state| !std::mem::replace(&mut state.is_open, true));
        let is_new = |state: &StimulusState| state.sequence > known;
        let _ = tokio::time::timeout(STATE_TIMEOUT, seen.wait_for(is_new)).await;
        let state = self.state.borrow().clone();
        let image = self.images.get(state.index);
        let value = json!({
            "state": state, "target": self.target, "n": self.images.as_slice().len(),
            "label": image.map_or("", |image| &image.label),
        });
        answer(StatusCode::OK, "application/json", value.to_string())
    }

    async fn image(&self, index: usize) -> Answer {
        let Some(image) = self.images.get(index) else { return refusal(StatusCode::NOT_FOUND) };
        match tokio::fs::read(&image.path).await {
            Ok(body) => answer(StatusCode::OK, image.media_type, body),
            Err(_) => refusal(StatusCode::NOT_FOUND),
        }
    }

    /// Takes what the page posts; false when it is invalid.
    fn take(&self, path: &str, body: &[u8]) -> bool {
        let n_images = self.images.as_slice().len();
        match path {
            "/shown" => serde_json::from_slice::<Shown>(body)
                .map(|shown| self.state.send_if_modified(|state| state.confirm(shown)))
                .is_ok(),
            "/step" => serde_json::from_slice::<PageStep>(body)
                .map(|step| self.state.send_modify(|state| state.step(step.by, n_images)))
                .is_ok(),
            "/pause" => serde_json::from_slice::<PagePause>(body)
                .map(|pause| self.state.send_modify(|state| state.pause(pause.is_paused)))
                .is_ok(),
            "/scale" => serde_json::from_slice::<PageScale>(body).is_ok_and(|scale| {
                self.state.send_if_modified(|state| state.calibrate(scale.px_per_mm))
            }),
            _ => false,
        }
    }
}

/// Answers requests until the runtime ends.
pub(super) async fn accept(listener: TcpListener, server: Arc<PageServer>) {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let Ok(place) = Arc::clone(&places).acquire_owned().await else { return };
        // A client that left before it was accepted needs no answer.
        let Ok((socket, _)) = listener.accept().await else { continue };
        let server = Arc::clone(&server);
        tokio::spawn(async move {
            serve(socket, &server).await;
            drop(place);
        });
    }
}

async fn serve(socket: TcpStream, server: &PageServer) {
    let service = service_fn(async |request| Ok::<_, Infallible>(server.answer(request).await));
    // A connection whose head is late is closed without status 408, which hyper does not send
    // there. RFC 9112, 9.5 permits it, and the page repeats its request in either case.
    let connection = http1::Builder::new()
        .keep_alive(false)
        .max_header_size(MAX_HEAD_BYTES)
        .timer(TokioTimer::new())
        .header_read_timeout(REQUEST_TIMEOUT)
        .serve_connection(TokioIo::new(socket), service);
    // A page that was closed takes no answer.
    let limit = REQUEST_TIMEOUT + REQUEST_TIMEOUT + STATE_TIMEOUT + ANSWER_TIMEOUT;
    let _ = tokio::time::timeout(limit, connection).await;
}
