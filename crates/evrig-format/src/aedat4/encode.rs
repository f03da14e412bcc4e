//! Values to payloads.

use super::memory::grow;
use aedat::frame_generated::{self as frame, FrameFormat};
use aedat::imus_generated as imus;
use aedat::triggers_generated as triggers;
use evrig_core::event::EventSlice;
use evrig_core::frame::{Channels, Frame, Samples};
use evrig_core::imu::{ImuSample, Trigger};
use evrig_core::time::{Davis, Stamp};
use flatbuffers::FlatBufferBuilder;

/// Fields of a frame that dv-processing added after `aedat`'s schema: exposure in µs, kind of
/// source.
const VT_EXPOSURE: u16 = 26;
const VT_SOURCE: u16 = 28;

/// `dv::FrameSource::SENSOR`.
const FROM_SENSOR: i8 = 1;

/// The first 32 bytes of an event packet up to the number of events: size (replaced), root at 16,
/// identifier, a virtual table of one field at 4, the table, and the vector's offset.
const EVENTS_HEAD: [u8; 32] = [
    0, 0, 0, 0, 16, 0, 0, 0, b'E', b'V', b'T', b'S', 0, 0, 6, 0, //
    8, 0, 4, 0, 6, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0,
];

/// Bytes of an event, without compression.
pub const EVENT_BYTES: usize = 16;

/// Writes an event packet to `out`, from the byte `at`, and returns its end; `out` grows as
/// needed and is never shrunk. Coordinates must be below 32,768.
pub(super) fn events(events: EventSlice<'_>, out: &mut Vec<u8>, at: usize) -> usize {
    let start = at + EVENTS_HEAD.len();
    let end = start + EVENT_BYTES * events.len();
    grow(out, end);
    let head = &mut out[at..start];
    head.copy_from_slice(&EVENTS_HEAD);
    head[..4].copy_from_slice(&((end - at - 4) as u32).to_le_bytes());
    head[28..].copy_from_slice(&(events.len() as u32).to_le_bytes());
    let (cells, _) = out[start..end].as_chunks_mut::<EVENT_BYTES>();
    let coordinates = events.x.iter().zip(events.y).zip(events.on);
    for ((cell, &t), ((&x, &y), &on)) in cells.iter_mut().zip(events.t).zip(coordinates) {
        let low = u128::from(t as u64);
        let high = u128::from(x) | u128::from(y) << 16 | u128::from(on) << 32;
        *cell = (low | high << 64).to_le_bytes();
    }
    end
}

/// A frame's packet. Its size must be below 32,768 each way.
pub(super) fn frame(picture: &Frame<Davis>) -> Vec<u8> {
    let wide;
    let (pixels, depth) = match &picture.samples {
        Samples::U8(samples) => (samples.as_slice(), 0),
        Samples::U16(samples) => {
            wide = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect::<Vec<_>>();
            (wide.as_slice(), 2)
        }
    };
    let n_channels: i8 = match picture.channels {
        Channels::Gray => 1,
        Channels::Bgr => 3,
        Channels::Bgra => 4,
    };
    let mut builder = FlatBufferBuilder::with_capacity(pixels.len() + 256);
    let pixels = builder.create_vector_direct(pixels);
    let table = builder.start_table();
    let timing = &picture.timing;
    push_micros(&mut builder, frame::Frame::VT_T, timing.stamp);
    if let Some([begin, end]) = timing.readout {
        push_micros(&mut builder, frame::Frame::VT_BEGIN_T, begin);
        push_micros(&mut builder, frame::Frame::VT_END_T, end);
    }
    if let Some([begin, end]) = timing.exposure {
        push_micros(&mut builder, frame::Frame::VT_EXPOSURE_BEGIN_T, begin);
        push_micros(&mut builder, frame::Frame::VT_EXPOSURE_END_T, end);
        builder.push_slot(VT_EXPOSURE, end.as_micros().saturating_sub(begin.as_micros()), 0);
    }
    builder.push_slot_always(frame::Frame::VT_PIXELS, pixels);
    builder.push_slot_always(frame::Frame::VT_WIDTH, picture.size.width as i16);
    builder.push_slot_always(frame::Frame::VT_HEIGHT, picture.size.height as i16);
    builder.push_slot_always(frame::Frame::VT_OFFSET_X, picture.origin[0]);
    builder.push_slot_always(frame::Frame::VT_OFFSET_Y, picture.origin[1]);
    builder.push_slot_always(frame::Frame::VT_FORMAT, FrameFormat((n_channels - 1) << 3 | depth));
    builder.push_slot_always(VT_SOURCE, FROM_SENSOR);
    let root = builder.end_table(table);
    builder.finish_size_prefixed(root, Some(frame::FRAME_IDENTIFIER));
    builder.finished_data().to_vec()
}

fn push_micros(builder: &mut FlatBufferBuilder<'_>, slot: u16, stamp: Stamp<Davis>) {
    builder.push_slot(slot, stamp.as_micros(), 0);
}

/// A packet of inertial samples.
pub(super) fn imu(samples: &[ImuSample]) -> Vec<u8> {
    let mut builder = FlatBufferBuilder::with_capacity(64 * samples.len() + 64);
    let mut tables = Vec::with_capacity(samples.len());
    for sample in samples {
        let [accelerometer_x, accelerometer_y, accelerometer_z] = sample.acceleration_g;
        let [gyroscope_x, gyroscope_y, gyroscope_z] = sample.rotation_deg_per_s;
        let [magnetometer_x, magnetometer_y, magnetometer_z] = sample.magnetic_ut;
        let arguments = imus::ImuArgs {
            t: sample.stamp.as_micros(),
            temperature: sample.temperature_c,
            accelerometer_x,
            accelerometer_y,
            accelerometer_z,
            gyroscope_x,
            gyroscope_y,
            gyroscope_z,
            magnetometer_x,
            magnetometer_y,
            magnetometer_z,
        };
        tables.push(imus::Imu::create(&mut builder, &arguments));
    }
    let elements = builder.create_vector(&tables);
    let arguments = imus::ImuPacketArgs { elements: Some(elements) };
    let root = imus::ImuPacket::create(&mut builder, &arguments);
    imus::finish_size_prefixed_imu_packet_buffer(&mut builder, root);
    builder.finished_data().to_vec()
}

/// A packet of triggers.
pub(super) fn triggers(marks: &[Trigger]) -> Vec<u8> {
    let mut builder = FlatBufferBuilder::with_capacity(32 * marks.len() + 64);
    let mut tables = Vec::with_capacity(marks.len());
    for mark in marks {
        let source = triggers::TriggerSource(mark.kind.code());
        let arguments = triggers::TriggerArgs { t: mark.stamp.as_micros(), source };
        tables.push(triggers::Trigger::create(&mut builder, &arguments));
    }
    let elements = builder.create_vector(&tables);
    let arguments = triggers::TriggerPacketArgs { elements: Some(elements) };
    let root = triggers::TriggerPacket::create(&mut builder, &arguments);
    triggers::finish_size_prefixed_trigger_packet_buffer(&mut builder, root);
    builder.finished_data().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};

    #[test]
    fn events_are_laid_out_as_dv_processing_lays_them_out() {
        // The first packet of a file of dv-processing 2.0.4: EventOnlyConfig, no compression,
        // push_back(1700000000000000, 2, 3, True); push_back(1700000000000010, 345, 259, False).
        let theirs: [u8; 64] = [
            0x3c, 0, 0, 0, 0x10, 0, 0, 0, b'E', b'V', b'T', b'S', 0, 0, 6, 0, //
            8, 0, 4, 0, 6, 0, 0, 0, 4, 0, 0, 0, 2, 0, 0, 0, //
            0, 0x40, 0x1e, 0x18, 0x24, 0x0a, 6, 0, 2, 0, 3, 0, 1, 0, 0, 0, //
            0x0a, 0x40, 0x1e, 0x18, 0x24, 0x0a, 6, 0, 0x59, 1, 3, 1, 0, 0, 0, 0,
        ];
        let ours: Events = [
            Event { t: 1_700_000_000_000_000, x: 2, y: 3, on: true },
            Event { t: 1_700_000_000_000_010, x: 345, y: 259, on: false },
        ]
        .into_iter()
        .collect();
        // What the memory held before does not show.
        let mut out = vec![0xee; 100];
        assert_eq!(events(ours.as_slice(), &mut out, 8), 72);
        assert_eq!(out[8..72], theirs);
        assert_eq!(events(ours.as_slice(), &mut Vec::new(), 0), 64);
    }
}
