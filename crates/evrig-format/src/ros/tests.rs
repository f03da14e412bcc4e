//! Messages written by hand, in both ways of writing them, are decoded to what was planted.

use super::*;
use evrig_core::frame::{Channels, Samples};

/// Writes a message either way.
pub(crate) struct MessageWriter {
    wire: RosWire,
    cdr: CdrBuilder,
    packed: Vec<u8>,
}

impl MessageWriter {
    pub(crate) fn new(wire: RosWire) -> Self {
        Self { wire, cdr: CdrBuilder::new(), packed: Vec::new() }
    }

    pub(crate) fn put<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        self.cdr.field(bytes);
        self.packed.extend(bytes);
        self
    }

    fn u32s(&mut self, values: &[u32]) -> &mut Self {
        for value in values {
            self.put(value.to_le_bytes());
        }
        self
    }

    fn f64s(&mut self, values: &[f64]) -> &mut Self {
        for value in values {
            self.put(value.to_le_bytes());
        }
        self
    }

    fn text(&mut self, text: &str) -> &mut Self {
        self.cdr.text(text);
        self.packed.extend((text.len() as u32).to_le_bytes());
        self.packed.extend(text.bytes());
        self
    }

    fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.cdr.bytes(bytes);
        self.packed.extend((bytes.len() as u32).to_le_bytes());
        self.packed.extend(bytes);
        self
    }

    fn header(&mut self) -> &mut Self {
        if self.wire == RosWire::Ros1 {
            self.packed.extend(7_u32.to_le_bytes());
        }
        self.u32s(&[1_500_000_000, 2_000]).text("cam")
    }

    fn finish(self) -> Vec<u8> {
        match self.wire {
            RosWire::Ros1 => self.packed,
            RosWire::Cdr => self.cdr.finish(),
        }
    }
}

/// A rgb8 image of 2 x 2 pixels whose rows are padded by a byte.
pub(crate) fn rgb_image(wire: RosWire) -> Vec<u8> {
    image("rgb8", 7, &[1, 2, 3, 4, 5, 6, 99, 7, 8, 9, 10, 11, 12, 99], wire)
}

fn image(encoding: &str, step: u32, data: &[u8], wire: RosWire) -> Vec<u8> {
    let mut message = MessageWriter::new(wire);
    message.header().u32s(&[2, 2]).text(encoding).put([0]).u32s(&[step]).bytes(data);
    message.finish()
}

/// A sample with 1 g along z and pi rad/s about x.
pub(crate) fn imu_message(wire: RosWire) -> Vec<u8> {
    let mut message = MessageWriter::new(wire);
    message.header().f64s(&[0.0; 13]).f64s(&[std::f64::consts::PI, 0.0, 0.0]).f64s(&[0.0; 9]);
    message.f64s(&[0.0, 0.0, STANDARD_GRAVITY]).f64s(&[0.0; 9]);
    message.finish()
}

fn packet(encoding: &str, data: &[u8], wire: RosWire) -> Vec<u8> {
    let mut message = MessageWriter::new(wire);
    message.header().u32s(&[480, 640]);
    message.put(5_u64.to_le_bytes()).put(1_000_u64.to_le_bytes());
    message.text(encoding).put([0]).bytes(data);
    message.finish()
}

const BOTH: [RosWire; 2] = [RosWire::Ros1, RosWire::Cdr];

/// The stamp of [`MessageWriter::header`], µs.
const STAMP_US: i64 = 1_500_000_000_000_002;

fn take(decoder: &mut RosDecoder, kind: &str, wire: RosWire, data: &[u8]) -> Option<Content> {
    decoder.take("/topic", kind, wire, data).unwrap().map(|(_, content)| content)
}

fn rows(content: Option<Content>) -> Vec<(i64, u16, u16, bool)> {
    let Some(Content::Events(events)) = content else { panic!("expected events") };
    events.as_slice().iter().map(|e| (e.t, e.x, e.y, e.on)).collect()
}

#[test]
fn events_of_both_ways_of_writing_are_equal() {
    for wire in BOTH {
        let mut message = MessageWriter::new(wire);
        message.header().u32s(&[180, 240, 2]);
        for (x, y, ns, on) in [(239_u16, 179_u16, 1_999_u32, 1), (3, 4, 5_000, 0)] {
            message.put(x.to_le_bytes()).put(y.to_le_bytes()).u32s(&[7, ns]).put([on]);
        }
        let message = message.finish();
        for kind in ["dvs_msgs/msg/EventArray", "prophesee_event_msgs/EventArray"] {
            let found = take(&mut RosDecoder::default(), kind, wire, &message);
            assert_eq!(rows(found), [(7_000_001, 239, 179, true), (7_000_005, 3, 4, false)]);
        }
    }
}

#[test]
fn images_are_read_without_their_padding_and_others_named() {
    for wire in BOTH {
        let decoder = &mut RosDecoder::default();
        let found = take(decoder, "sensor_msgs/msg/Image", wire, &rgb_image(wire));
        let Some(Content::Frame(frame)) = found else { panic!("expected a frame") };
        assert_eq!(frame.timing.stamp.as_micros(), STAMP_US);
        assert_eq!((frame.size, frame.channels), (Size::new(2, 2), Channels::Bgr));
        assert_eq!(frame.samples, Samples::U8(vec![3, 2, 1, 6, 5, 4, 9, 8, 7, 12, 11, 10]));
        let deep = image("mono16", 4, &[1, 2, 3, 4, 5, 6, 7, 8], wire);
        let Some(Content::Frame(frame)) = take(decoder, "sensor_msgs/Image", wire, &deep) else {
            panic!("expected a frame")
        };
        assert_eq!(frame.samples, Samples::U16(vec![0x201, 0x403, 0x605, 0x807]));
        let bayer = image("bayer_rggb8", 2, &[0; 4], wire);
        assert_eq!(take(decoder, "sensor_msgs/Image", wire, &bayer), None);
        assert!(decoder.notes.left_out[0].0.contains("bayer_rggb8"));
        let short = image("mono8", 2, &[0; 3], wire);
        assert!(decoder.take("/topic", "sensor_msgs/Image", wire, &short).is_err());
    }
}

#[test]
fn inertial_samples_are_in_g_and_degrees() {
    for wire in BOTH {
        let found = take(&mut RosDecoder::default(), "sensor_msgs/Imu", wire, &imu_message(wire));
        let Some(Content::Imu(samples)) = found else { panic!("expected a sample") };
        assert_eq!(samples[0].acceleration_g, [0.0, 0.0, 1.0]);
        assert_eq!(samples[0].rotation_deg_per_s, [180.0, 0.0, 0.0]);
        assert_eq!(samples[0].stamp.as_micros(), STAMP_US);
    }
}

#[test]
fn packets_go_on_from_one_message_to_the_next_on_the_clock_of_their_stamps() {
    for wire in BOTH {
        let decoder = &mut RosDecoder::default();
        let kind = "event_camera_msgs/msg/EventPacket";
        let words: [u16; 4] = [0x8001, 0x6002, 0x0005, 0x2803];
        let words = words.map(u16::to_le_bytes).concat();
        let first = take(decoder, kind, wire, &packet("evt3", &words, wire));
        assert_eq!(rows(first), [(STAMP_US, 3, 5, true)]);
        let words = [0x6007_u16, 0x2004].map(u16::to_le_bytes).concat();
        let second = take(decoder, kind, wire, &packet("evt3", &words, wire));
        assert_eq!(rows(second), [(STAMP_US + 5, 4, 5, false)]);
        let word = (1_u64 << 63) | (17 << 48) | (639 << 32) | 2_500;
        let mono = packet("mono", &word.to_le_bytes(), wire);
        let found = decoder.take("/mono", kind, wire, &mono).unwrap().unwrap();
        assert_eq!(found.0.size, Some(Size::new(640, 480)));
        assert_eq!(rows(Some(found.1)), [(STAMP_US + 2, 639, 17, true)]);
        assert_eq!(take(decoder, kind, wire, &packet("libcaer", &[], wire)), None);
        assert!(decoder.notes.left_out[0].0.contains("libcaer"), "{:?}", decoder.notes);
    }
}

#[test]
fn a_cut_message_is_an_error_and_never_more() {
    for wire in BOTH {
        for (kind, whole) in [
            ("sensor_msgs/Image", rgb_image(wire)),
            ("sensor_msgs/Imu", imu_message(wire)),
            ("event_camera_msgs/EventPacket", packet("mono", &[0; 8], wire)),
        ] {
            for n in 0..whole.len() {
                let found = RosDecoder::default().take("/t", kind, wire, &whole[..n]);
                assert!(found.is_err() || kind == "sensor_msgs/Imu" && n > whole.len() - 73);
            }
        }
    }
}
