//! Foxglove's WebSocket: one channel per topic, in Foxglove's published schemas.
//!
//! A slow viewer loses the oldest messages of its queue.

use super::{EventImage, LiveError, LiveStatus};
use ::foxglove::messages::{
    Color, ImageAnnotations, Point2, PointsAnnotation, PoseInFrame, Quaternion, RawImage,
    Timestamp, Vector3, points_annotation,
};
use ::foxglove::{
    Channel, ChannelBuilder, Context, RawChannel, Schema, WebSocketServer, WebSocketServerHandle,
};
use evrig_core::frame::{Channels, Frame, Samples};
use evrig_core::geometry::Size;
use evrig_core::pi_camera::PiFrame;
use evrig_core::raw10;
use evrig_core::time::{Davis, Stamp, Unix};
use evrig_session::HostTime;
use evrig_session::rig::Pose;
use std::net::SocketAddr;
use std::sync::Arc;

/// Messages held for a viewer: half a second of everything.
const BACKLOG: usize = 64;
const STATUS: &str = r#"{"title": "evrig.LiveStatus", "type": "object"}"#;

/// The server and its channels.
pub(super) struct Foxglove {
    address: SocketAddr,
    server: Option<WebSocketServerHandle>,
    /// Channels leave their server with it.
    _context: Arc<Context>,
    davis_frame: Channel<RawImage>,
    tag: Channel<ImageAnnotations>,
    events: Channel<RawImage>,
    pi_raw: Channel<RawImage>,
    pi_rgb: Channel<RawImage>,
    pose: Channel<PoseInFrame>,
    status: Arc<RawChannel>,
}

impl std::fmt::Debug for Foxglove {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Foxglove").field("address", &self.address).finish_non_exhaustive()
    }
}

impl Foxglove {
    pub(super) fn serve(address: SocketAddr) -> Result<Self, LiveError> {
        let failed = |error: ::foxglove::FoxgloveError| LiveError::Foxglove {
            address,
            because: error.to_string(),
        };
        let context = Context::new();
        let server = WebSocketServer::new()
            .name("evrig")
            .bind(address.ip().to_string(), address.port())
            .message_backlog_size(BACKLOG)
            .context(&context)
            .start_blocking()
            .map_err(failed)?;
        let channel = |topic: &str| ChannelBuilder::new(topic).context(&context);
        let status = channel("/evrig/status")
            .message_encoding("json")
            .schema(Schema::new("evrig.LiveStatus", "jsonschema", STATUS.as_bytes()))
            .build_raw()
            .map_err(failed)?;
        Ok(Self {
            address: SocketAddr::new(address.ip(), server.port()),
            server: Some(server),
            davis_frame: channel("/davis/frame").build(),
            tag: channel("/davis/tag").build(),
            events: channel("/davis/events").build(),
            pi_raw: channel("/pi/raw").build(),
            pi_rgb: channel("/pi/rgb").build(),
            pose: channel("/arm/pose").build(),
            status,
            _context: context,
        })
    }

    pub(super) const fn address(&self) -> SocketAddr {
        self.address
    }

    pub(super) fn davis_frame(&self, frame: &Frame<Davis>, corners: Option<[[f64; 2]; 4]>) {
        let at = time(Stamp::from_nanos(frame.timing.stamp.as_nanos()));
        let (encoding, data) = match (&frame.samples, frame.channels) {
            (Samples::U8(samples), Channels::Gray) => ("mono8", samples.clone()),
            (Samples::U8(samples), Channels::Bgr) => ("bgr8", samples.clone()),
            (Samples::U8(samples), Channels::Bgra) => ("bgra8", samples.clone()),
            (Samples::U16(samples), _) => {
                ("mono16", samples.iter().flat_map(|sample| sample.to_le_bytes()).collect())
            }
        };
        self.davis_frame.log(&image(at, frame.size, encoding, "davis", data));
        let outline = |corners: [[f64; 2]; 4]| PointsAnnotation {
            timestamp: at,
            r#type: points_annotation::Type::LineLoop as i32,
            points: corners.map(|[x, y]| Point2 { x, y }).to_vec(),
            outline_color: Some(Color { r: 0.1, g: 0.8, b: 0.2, a: 1.0 }),
            thickness: 2.0,
            ..Default::default()
        };
        let points = corners.map(outline).into_iter().collect();
        self.tag.log(&ImageAnnotations { timestamp: at, points, ..Default::default() });
    }

    pub(super) fn pi_frame(&self, frame: &PiFrame) {
        let (at, size) = (time(frame.metadata.real_time), frame.metadata.size);
        let unpacked = frame.raw10.as_ref().and_then(|packed| {
            let row = raw10::row_bytes(size.width).ok()?;
            raw10::unpack(packed, size, row).ok()
        });
        if let Some(samples) = unpacked {
            let data = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
            self.pi_raw.log(&image(at, size, "mono16", "pi", data));
        }
        if let Some(rgb) = &frame.rgb {
            self.pi_rgb.log(&image(at, size, "rgb8", "pi", rgb.clone()));
        }
    }

    pub(super) fn events(&self, event_image: &EventImage, now: HostTime) {
        let data = event_image.rgb.clone();
        self.events.log(&image(time(now.unix), event_image.size, "rgb8", "davis", data));
    }

    pub(super) fn status(&self, status: &LiveStatus, pose: Option<Pose>, now: HostTime) {
        if let Ok(bytes) = serde_json::to_vec(status) {
            self.status.log(&bytes);
        }
        if let Some(pose) = pose {
            let [x, y, z] = pose.position_mm().map(|mm| mm * 1e-3);
            let (sin, cos) = (pose.r.0.to_radians() / 2.0).sin_cos();
            let pose = ::foxglove::messages::Pose {
                position: Some(Vector3 { x, y, z }),
                orientation: Some(Quaternion { x: 0.0, y: 0.0, z: sin, w: cos }),
            };
            let frame_id = "base".to_owned();
            self.pose.log(&PoseInFrame { timestamp: time(now.unix), frame_id, pose: Some(pose) });
        }
    }
}

impl Drop for Foxglove {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            server.stop().wait_blocking();
        }
    }
}

fn image(
    timestamp: Option<Timestamp>,
    size: Size,
    encoding: &str,
    camera: &str,
    data: Vec<u8>,
) -> RawImage {
    RawImage {
        timestamp,
        frame_id: camera.to_owned(),
        width: u32::from(size.width),
        height: u32::from(size.height),
        encoding: encoding.to_owned(),
        step: (data.len() / usize::from(size.height).max(1)) as u32,
        data: data.into(),
    }
}

/// None for a time before 1970 or beyond 2106, which Foxglove cannot hold.
fn time(at: Stamp<Unix>) -> Option<Timestamp> {
    let ns = u64::try_from(at.as_nanos()).ok()?;
    let seconds = u32::try_from(ns / 1_000_000_000).ok()?;
    Timestamp::new_checked(seconds, (ns % 1_000_000_000) as u32)
}
