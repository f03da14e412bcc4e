//! A check for the damage on which the verifier of flatbuffers 2.1 overflows.
//!
//! A table begins with the signed distance to its virtual table. The verifier takes that number's
//! absolute value, which `i32::MIN` does not have: a build with overflow checks panics. Here the
//! same tables are visited for that number only; the verifier does everything else.

/// Position of the root's offset, after the size.
const ROOT_AT: usize = 4;

/// First field of a virtual table, in which every AEDAT4 packet holds its vector of elements.
const FIRST_FIELD: usize = 4;

/// Refuses a size-prefixed flatbuffer whose root, or one of whose vector of tables, begins with the
/// distance that overflows the verifier; the error describes what was found.
pub(super) fn check(payload: &[u8], holds_tables: bool) -> Result<(), String> {
    let is_impossible = |table: usize| i32_at(payload, table) == Some(i32::MIN);
    let refused = || "an invalid flatbuffer (a table that names no virtual table)".to_owned();
    let Some(root) = follow(payload, ROOT_AT) else { return Ok(()) };
    if is_impossible(root) {
        return Err(refused());
    }
    let vector = if holds_tables { first_field(payload, root) } else { None };
    let Some((vector, n)) = vector.and_then(|at| Some((at, u32_at(payload, at)?))) else {
        return Ok(());
    };
    // The vector is left at the first offset outside the payload, which the verifier refuses.
    let mut elements = (1..=n as usize).map_while(|i| follow(payload, vector + 4 * i));
    if elements.any(is_impossible) { Err(refused()) } else { Ok(()) }
}

/// Position of the vector of a table's first field, if there is one.
fn first_field(payload: &[u8], table: usize) -> Option<usize> {
    let distance = i64::from(i32_at(payload, table)?);
    let virtual_table = usize::try_from(i64::try_from(table).ok()? - distance).ok()?;
    let [length, offset] =
        [virtual_table, virtual_table.checked_add(FIRST_FIELD)?].map(|at| u16_at(payload, at));
    let is_present = usize::from(length?) > FIRST_FIELD && offset? != 0;
    if is_present { follow(payload, table + usize::from(offset?)) } else { None }
}

/// Target of the offset at a position.
fn follow(payload: &[u8], at: usize) -> Option<usize> {
    at.checked_add(u32_at(payload, at)? as usize)
}

fn u16_at(payload: &[u8], at: usize) -> Option<u16> {
    payload.get(at..)?.first_chunk().map(|bytes| u16::from_le_bytes(*bytes))
}

fn u32_at(payload: &[u8], at: usize) -> Option<u32> {
    payload.get(at..)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
}

fn i32_at(payload: &[u8], at: usize) -> Option<i32> {
    u32_at(payload, at).map(u32::cast_signed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aedat4::decode::decode;
    use crate::aedat4::table::{self, TableEntry};
    use crate::aedat4::{Compression, PayloadKind, StreamSpec, encode, header};
    use evrig_core::event::{Event, Events};
    use evrig_core::frame::{Frame, FrameTiming, Samples};
    use evrig_core::geometry::Size;
    use evrig_core::imu::{ImuSample, Trigger, TriggerKind};
    use evrig_core::time::Stamp;

    /// Puts `i32::MIN` at each place in turn and returns how many of them `check` refuses.
    fn plant(payload: &[u8], holds_tables: bool, read: impl Fn(&[u8])) -> usize {
        let mut n_refused = 0;
        for at in (0..payload.len() - 3).step_by(2) {
            let mut changed = payload.to_vec();
            changed[at..at + 4].copy_from_slice(&i32::MIN.to_le_bytes());
            read(&changed);
            n_refused += usize::from(check(&changed, holds_tables).is_err());
        }
        n_refused
    }

    #[test]
    fn a_table_without_the_distance_to_its_virtual_table_is_an_error_in_every_packet() {
        let event = Event { t: 7, x: 1, y: 2, on: true };
        let sample = ImuSample {
            stamp: Stamp::from_micros(5),
            temperature_c: 1.0,
            acceleration_g: [1.0; 3],
            rotation_deg_per_s: [2.0; 3],
            magnetic_ut: [3.0; 3],
        };
        let mark = Trigger { stamp: Stamp::from_micros(5), kind: TriggerKind::from_code(1) };
        let frame = Frame::gray(
            FrameTiming::from_stamp(Stamp::from_micros(5)),
            Size::new(3, 2),
            Samples::U8(vec![9; 6]),
        );
        let events: Events = [event; 3].into_iter().collect();
        let mut event_packet = Vec::new();
        encode::events(events.as_slice(), &mut event_packet, 0);
        let packets = [
            (PayloadKind::Events, event_packet, 1),
            (PayloadKind::Frames, encode::frame(&frame), 1),
            (PayloadKind::Imu, encode::imu(&[sample; 3]), 4),
            (PayloadKind::Triggers, encode::triggers(&[mark; 3]), 4),
        ];
        for (kind, payload, n_tables) in packets {
            let read = |payload: &[u8]| drop(decode(&kind, payload, Events::new()));
            let holds_tables = matches!(kind, PayloadKind::Imu | PayloadKind::Triggers);
            assert!(plant(&payload, holds_tables, read) >= n_tables, "{kind:?}");
            assert_eq!(check(&payload, holds_tables), Ok(()));
        }
    }

    #[test]
    fn a_header_and_a_data_table_with_such_a_table_are_errors() {
        let streams = [StreamSpec::imu("camera")];
        let bytes = header::encode(Compression::None, Some(9), &streams);
        assert!(plant(&bytes, false, |bytes| drop(header::parse(bytes))) >= 1);
        let entry = TableEntry {
            payload_offset: 9,
            stream: 1,
            payload_bytes: 7,
            n_elements: 3,
            span_us: [0, 5],
        };
        let bytes = table::encode(&[entry; 3]);
        assert!(plant(&bytes, true, |bytes| drop(table::count(bytes))) >= 4);
    }
}
