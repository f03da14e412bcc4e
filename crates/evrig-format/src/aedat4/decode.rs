//! Payloads to values.

use super::header::one_line;
use super::{Content, PayloadKind, overflow};
use aedat::events_generated::{self as events, Event};
use aedat::frame_generated as frame;
use aedat::imus_generated as imus;
use aedat::triggers_generated as triggers;
use evrig_core::event::Events;
use evrig_core::frame::{Channels, Frame, FrameTiming, Samples};
use evrig_core::geometry::Size;
use evrig_core::imu::{ImuSample, Trigger, TriggerKind};
use evrig_core::time::{Davis, Span, Stamp};
use flatbuffers::VerifierOptions;

/// Bytes of the size prefix and root offset before the identifier, and of the identifier.
const IDENTIFIER_AT: std::ops::Range<usize> = 8..12;

/// A payload's values, and what could not be represented.
#[derive(Debug)]
pub(super) struct Decoded {
    /// None for a frame that could not be represented.
    pub(super) content: Option<Content>,
    /// Events that could not be represented.
    pub(super) lost_events: u64,
    /// Why something was lost.
    pub(super) reason: Option<String>,
}

impl Decoded {
    pub(super) fn whole(content: Content) -> Self {
        Self { content: Some(content), lost_events: 0, reason: None }
    }
}

/// Decodes a decompressed payload of a known kind, events into the memory of `spare`; the error
/// describes what was found instead.
pub(super) fn decode(kind: &PayloadKind, payload: &[u8], spare: Events) -> Result<Decoded, String> {
    check_identifier(kind, payload)?;
    overflow::check(payload, matches!(kind, PayloadKind::Imu | PayloadKind::Triggers))?;
    // Every sample is a table of its own, so the usual limit of a million tables is too low;
    // the payload's length bounds them as well.
    let options = VerifierOptions { max_tables: payload.len(), ..VerifierOptions::default() };
    match kind {
        PayloadKind::Events => {
            events::size_prefixed_root_as_event_packet_with_opts(&options, payload)
                .map(|packet| decode_events(packet.elements().unwrap_or_default(), spare))
        }
        PayloadKind::Frames => frame::size_prefixed_root_as_frame_with_opts(&options, payload)
            .map(|table| decode_frame(&table)),
        PayloadKind::Imu => imus::size_prefixed_root_as_imu_packet_with_opts(&options, payload)
            .map(|packet| Decoded::whole(Content::Imu(decode_imu(&packet)))),
        PayloadKind::Triggers => {
            triggers::size_prefixed_root_as_trigger_packet_with_opts(&options, payload)
                .map(|packet| Decoded::whole(Content::Triggers(decode_triggers(&packet))))
        }
        PayloadKind::Other(kind) => Ok(Decoded::whole(Content::Unknown { kind: kind.clone() })),
    }
    .map_err(|error| one_line(&error))
}

fn check_identifier(kind: &PayloadKind, payload: &[u8]) -> Result<(), String> {
    let found = payload.get(IDENTIFIER_AT).ok_or_else(|| {
        format!("{} bytes, too few for a size, a root and an identifier", payload.len())
    })?;
    if found == kind.identifier().as_bytes() || matches!(kind, PayloadKind::Other(_)) {
        Ok(())
    } else {
        Err(format!("identifier \"{}\"", found.escape_ascii()))
    }
}

/// Splits the 16-byte events (i64 t, i16 x, i16 y, bool on, 3 bytes padding) into columns in one
/// pass.
fn decode_events(elements: &[Event], spare: Events) -> Decoded {
    let (mut t, mut x, mut y, mut on) = spare.into_columns();
    t.resize(elements.len(), 0);
    x.resize(elements.len(), 0);
    y.resize(elements.len(), 0);
    on.resize(elements.len(), false);
    let times = elements.iter().zip(&mut t);
    let places = x.iter_mut().zip(&mut y).zip(&mut on);
    let mut union = 0;
    for ((event, t), ((x, y), on)) in times.zip(places) {
        let event = u128::from_le_bytes(event.0);
        let place = (event >> 64) as u64;
        *t = event as i64;
        *x = place as u16;
        *y = (place >> 16) as u16;
        *on = (place >> 32) as u8 != 0;
        union |= place;
    }
    // The sign bits of the union are set if any coordinate is negative.
    if union & 0x8000_8000 != 0 {
        return decode_representable_events(elements);
    }
    let columns = Events::from_columns(t, x, y, on).unwrap_or_default();
    Decoded::whole(Content::Events(columns))
}

fn decode_representable_events(elements: &[Event]) -> Decoded {
    let represent = |event: &Event| {
        let x = u16::try_from(x_of(event)).ok()?;
        let y = u16::try_from(y_of(event)).ok()?;
        Some(evrig_core::event::Event { t: t_of(event), x, y, on: on_of(event) })
    };
    let kept: Events = elements.iter().filter_map(represent).collect();
    let first = elements.iter().find(|event| represent(event).is_none());
    let reason = first.map(|event| {
        format!("an event at t {} us, x {}, y {}", t_of(event), x_of(event), y_of(event))
    });
    let lost_events = (elements.len() - kept.len()) as u64;
    Decoded { content: Some(Content::Events(kept)), lost_events, reason }
}

fn t_of(event: &Event) -> i64 {
    let [a, b, c, d, e, f, g, h, ..] = event.0;
    i64::from_le_bytes([a, b, c, d, e, f, g, h])
}

fn x_of(event: &Event) -> i16 {
    i16::from_le_bytes([event.0[8], event.0[9]])
}

fn y_of(event: &Event) -> i16 {
    i16::from_le_bytes([event.0[10], event.0[11]])
}

fn on_of(event: &Event) -> bool {
    event.0[12] != 0
}

fn decode_frame(table: &frame::Frame<'_>) -> Decoded {
    match represent_frame(table) {
        Ok(frame) => Decoded::whole(Content::Frame(frame)),
        Err(reason) => Decoded { content: None, lost_events: 0, reason: Some(reason) },
    }
}

fn represent_frame(table: &frame::Frame<'_>) -> Result<Frame<Davis>, String> {
    let (width, height) = (table.width(), table.height());
    let (Ok(columns), Ok(rows)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(format!("a frame of {width} x {height} pixels"));
    };
    let size = Size::new(columns, rows);
    let (channels, bits) = layout(table.format().0)?;
    let pixels = table.pixels().unwrap_or_default();
    let n_expected = size.n_pixels() * channels.count() * bits / 8;
    if pixels.len() != n_expected {
        return Err(format!(
            "a frame of {size} pixels, {} channels, {bits} bits with {} bytes instead of {n_expected}",
            channels.count(),
            pixels.len(),
        ));
    }
    let samples = if bits == 8 {
        Samples::U8(pixels.to_vec())
    } else {
        Samples::U16(pixels.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect())
    };
    let timing = FrameTiming {
        stamp: Stamp::from_micros(table.t()),
        exposure: interval(table.exposure_begin_t(), table.exposure_end_t()),
        readout: interval(table.begin_t(), table.end_t()),
        row_time: Span::ZERO,
    };
    let origin = [table.offset_x(), table.offset_y()];
    Ok(Frame { timing, size, origin, channels, samples })
}

/// Channels and bits per sample of an OpenCV type code: depth in the lowest three bits, channels
/// minus one above.
fn layout(code: i8) -> Result<(Channels, usize), String> {
    let bits = match code & 7 {
        0 => 8,
        2 => 16,
        _ => return Err(format!("a frame of OpenCV type {code}, neither 8 nor 16 bits unsigned")),
    };
    let channels = match code >> 3 {
        0 => Channels::Gray,
        2 => Channels::Bgr,
        3 => Channels::Bgra,
        _ => return Err(format!("a frame of OpenCV type {code}, not of 1, 3 or 4 channels")),
    };
    Ok((channels, bits))
}

/// Zero means "not stated": flatbuffers omit fields of that value.
fn interval(begin_us: i64, end_us: i64) -> Option<[Stamp<Davis>; 2]> {
    let is_stated = begin_us != 0 && end_us >= begin_us;
    is_stated.then(|| [Stamp::from_micros(begin_us), Stamp::from_micros(end_us)])
}

fn decode_imu(packet: &imus::ImuPacket<'_>) -> Vec<ImuSample> {
    let Some(elements) = packet.elements() else { return Vec::new() };
    let sample = |imu: imus::Imu<'_>| ImuSample {
        stamp: Stamp::from_micros(imu.t()),
        temperature_c: imu.temperature(),
        acceleration_g: [imu.accelerometer_x(), imu.accelerometer_y(), imu.accelerometer_z()],
        rotation_deg_per_s: [imu.gyroscope_x(), imu.gyroscope_y(), imu.gyroscope_z()],
        magnetic_ut: [imu.magnetometer_x(), imu.magnetometer_y(), imu.magnetometer_z()],
    };
    elements.iter().map(sample).collect()
}

fn decode_triggers(packet: &triggers::TriggerPacket<'_>) -> Vec<Trigger> {
    let Some(elements) = packet.elements() else { return Vec::new() };
    let trigger = |trigger: triggers::Trigger<'_>| Trigger {
        stamp: Stamp::from_micros(trigger.t()),
        kind: TriggerKind::from_code(trigger.source().0),
    };
    elements.iter().map(trigger).collect()
}

#[cfg(test)]
mod tests {
    use super::super::encode;
    use super::*;
    use aedat::frame_generated::{FrameArgs, FrameFormat};
    use evrig_core::event::EventSlice;

    fn frame_payload(width: i16, height: i16, code: i8, n_bytes: usize) -> Vec<u8> {
        let mut builder = flatbuffers::FlatBufferBuilder::new();
        let pixels = builder.create_vector(&vec![7_u8; n_bytes]);
        let arguments = FrameArgs {
            t: 5,
            width,
            height,
            format: FrameFormat(code),
            pixels: Some(pixels),
            ..FrameArgs::default()
        };
        let root = frame::Frame::create(&mut builder, &arguments);
        frame::finish_size_prefixed_frame_buffer(&mut builder, root);
        builder.finished_data().to_vec()
    }

    #[test]
    fn a_frame_of_impossible_size_is_a_loss_that_says_why() {
        for (width, height, code, n_bytes, reason) in [
            (4, 2, 0, 7, "with 7 bytes instead of 8"),
            (4, 2, 16, 8, "3 channels, 8 bits with 8 bytes instead of 24"),
            (4, 2, 2, 8, "16 bits with 8 bytes instead of 16"),
            (-4, 2, 0, 8, "a frame of -4 x 2 pixels"),
            (i16::MAX, i16::MAX, 26, 0, "32767 x 32767"),
            (4, 2, 5, 32, "OpenCV type 5"),
            (4, 2, 8, 16, "OpenCV type 8"),
            (4, 2, -1, 16, "OpenCV type -1"),
        ] {
            let payload = frame_payload(width, height, code, n_bytes);
            let decoded = decode(&PayloadKind::Frames, &payload, Events::new()).unwrap();
            assert!(decoded.content.is_none(), "{reason}");
            let found = decoded.reason.unwrap();
            assert!(found.contains(reason), "{found}");
        }
        let payload = frame_payload(4, 2, 24, 32);
        let decoded = decode(&PayloadKind::Frames, &payload, Events::new()).unwrap();
        let Some(Content::Frame(frame)) = decoded.content else { panic!("a frame") };
        assert_eq!((frame.size, frame.channels), (Size::new(4, 2), Channels::Bgra));
        assert_eq!(frame.timing.exposure, None, "no exposure was stated");
    }

    #[test]
    fn an_event_of_negative_coordinate_is_a_counted_loss_and_the_others_stay() {
        let columns = EventSlice {
            t: &[1, 2, 3],
            x: &[10, 0xffff, 30],
            y: &[1, 2, 3],
            on: &[true, false, true],
        };
        let mut payload = Vec::new();
        encode::events(columns, &mut payload, 0);
        let decoded = decode(&PayloadKind::Events, &payload, Events::new()).unwrap();
        let Some(Content::Events(events)) = decoded.content else { panic!("events") };
        assert_eq!((events.as_slice().t, events.as_slice().x), (&[1, 3][..], &[10, 30][..]));
        assert_eq!(decoded.lost_events, 1);
        assert_eq!(decoded.reason.unwrap(), "an event at t 2 us, x -1, y 2");
    }

    #[test]
    fn a_payload_of_another_kind_or_none_is_refused() {
        let payload = encode::triggers(&[]);
        let error = decode(&PayloadKind::Events, &payload, Events::new()).unwrap_err();
        assert_eq!(error, "identifier \"TRIG\"");
        for n in 0..payload.len() {
            assert!(
                decode(&PayloadKind::Triggers, &payload[..n], Events::new()).is_err(),
                "{n} bytes"
            );
        }
    }
}
