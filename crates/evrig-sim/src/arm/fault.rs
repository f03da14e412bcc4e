//! Fault injection: faults of a real serial line, on demand.

use evrig_core::time::Span;
use evrig_device::dobot::alarm::Alarm;
use evrig_device::dobot::id;
use std::str::FromStr;

/// Kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// The request never arrives (once).
    LostRequest,
    /// The request is done, its reply is lost (once).
    LostReply,
    /// The reply comes that much later (once).
    LateReply(Span),
    /// A bit of the reply is wrong (once).
    CorruptReply,
    /// Replies trickle in byte by byte from now on.
    Trickle,
    /// Nothing is answered or done from now on; motion under way goes on.
    Silence,
    /// Everything is answered with bytes that mean nothing from now on.
    Garbage,
    /// Everything is answered with a single FF from now on, as a wedged firmware does.
    Wedge,
    /// The cable is pulled.
    Unplug,
    /// An alarm comes up and motion ends.
    Alarm(Alarm),
    /// The arm is switched off and on.
    PowerCycle,
}

/// The request at which a fault occurs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultTrigger {
    /// Counts requests of this id only; of every id otherwise.
    pub id: Option<u8>,
    /// At which request, from 1.
    pub n: u64,
}

/// A fault and its trigger. As text: `KIND[=VALUE][@N | @NAME[#N]]`, for instance
/// `lost-reply@3` (the third request), `late-reply=150ms@PTP#2` (the second PTP),
/// `alarm=0x22@POSE`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// What.
    pub kind: FaultKind,
    /// When.
    pub moment: FaultTrigger,
}

/// A fault that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is not a fault: {because}; expected KIND[=VALUE][@N | @NAME[#N]] with KIND one of \
     {KINDS}"
)]
pub struct FaultError {
    text: String,
    because: &'static str,
}

const KINDS: &str = "lost-request, lost-reply, late-reply=MSms, corrupt-reply, trickle, silence, \
                     garbage, wedge, unplug, alarm=CODE, power-cycle";

impl Fault {
    /// A fault at the `n`-th request (from 1) of `id`.
    #[must_use]
    pub const fn at(kind: FaultKind, id: u8, n: u64) -> Self {
        Self { kind, moment: FaultTrigger { id: Some(id), n } }
    }
}

impl FromStr for Fault {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let wrong = |because| FaultError { text: text.to_owned(), because };
        let (what, moment) = text.split_once('@').unwrap_or((text, "1"));
        let (kind, value) = match what.split_once('=') {
            Some((kind, value)) => (kind, Some(value)),
            None => (what, None),
        };
        let kind = match (kind, value) {
            ("lost-request", None) => FaultKind::LostRequest,
            ("lost-reply", None) => FaultKind::LostReply,
            ("late-reply", Some(value)) => {
                let ms = value.strip_suffix("ms").and_then(|ms| ms.parse::<u32>().ok());
                let ms = ms.ok_or_else(|| wrong("the delay is not like 150ms"))?;
                FaultKind::LateReply(Span::from_micros(i64::from(ms) * 1_000))
            }
            ("corrupt-reply", None) => FaultKind::CorruptReply,
            ("trickle", None) => FaultKind::Trickle,
            ("silence", None) => FaultKind::Silence,
            ("garbage", None) => FaultKind::Garbage,
            ("wedge", None) => FaultKind::Wedge,
            ("unplug", None) => FaultKind::Unplug,
            ("alarm", Some(value)) => {
                let hex = value.strip_prefix("0x").unwrap_or(value);
                let code = u8::from_str_radix(hex, 16).ok().filter(|code| *code < 128);
                FaultKind::Alarm(Alarm(
                    code.ok_or_else(|| wrong("the alarm is not in 0x00..=0x7f"))?,
                ))
            }
            ("power-cycle", None) => FaultKind::PowerCycle,
            _ => return Err(wrong("the kind is unknown or its value is missing or too much")),
        };
        Ok(Self {
            kind,
            moment: parse_moment(moment).ok_or_else(|| wrong("the moment is unclear"))?,
        })
    }
}

/// `3`, `PTP`, `PTP#2`.
fn parse_moment(text: &str) -> Option<FaultTrigger> {
    if let Ok(n) = text.parse() {
        return (n > 0).then_some(FaultTrigger { id: None, n });
    }
    let (name, n) = text.split_once('#').unwrap_or((text, "1"));
    let id = (0..=u8::MAX).find(|id| id::name(*id) == Some(name))?;
    let n = n.parse().ok().filter(|n| *n > 0)?;
    Some(FaultTrigger { id: Some(id), n })
}

/// Pending and lasting faults.
#[derive(Debug, Default)]
pub struct Faults {
    waiting: Vec<Fault>,
    lasting: Vec<FaultKind>,
}

impl Faults {
    /// Faults to come.
    #[must_use]
    pub const fn new(waiting: Vec<Fault>) -> Self {
        Self { waiting, lasting: Vec::new() }
    }

    /// Adds a fault; its requests are counted from now.
    pub fn add(&mut self, fault: Fault) {
        self.waiting.push(fault);
    }

    /// Counts a request of `id` and gives the faults that occur at it.
    pub fn strike(&mut self, id: u8) -> Vec<FaultKind> {
        let mut struck = Vec::new();
        for fault in &mut self.waiting {
            if fault.moment.id.is_none_or(|only| only == id) {
                fault.moment.n -= 1;
                if fault.moment.n == 0 {
                    struck.push(fault.kind);
                }
            }
        }
        self.waiting.retain(|fault| fault.moment.n > 0);
        let lasts = |kind: &FaultKind| {
            matches!(
                kind,
                FaultKind::Trickle | FaultKind::Silence | FaultKind::Garbage | FaultKind::Wedge
            )
        };
        self.lasting.extend(struck.iter().filter(|kind| lasts(kind)));
        struck.retain(|kind| !lasts(kind));
        struck.extend(&self.lasting);
        struck
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_read_as_documented() {
        let moment = |id, n| FaultTrigger { id, n };
        let table = [
            ("lost-reply@3", FaultKind::LostReply, moment(None, 3)),
            (
                "late-reply=150ms@PTP#2",
                FaultKind::LateReply(Span::from_micros(150_000)),
                moment(Some(id::PTP), 2),
            ),
            ("alarm=0x22@POSE", FaultKind::Alarm(Alarm(0x22)), moment(Some(id::POSE), 1)),
            ("unplug", FaultKind::Unplug, moment(None, 1)),
        ];
        for (text, kind, moment) in table {
            assert_eq!(text.parse(), Ok(Fault { kind, moment }), "{text}");
        }
    }

    #[test]
    fn what_is_no_fault_is_refused_with_the_reason() {
        for text in
            ["", "late-reply", "late-reply=150", "alarm=0x90", "silence=3", "unplug@0", "x@PTP"]
        {
            let error = text.parse::<Fault>().unwrap_err().to_string();
            assert!(error.contains("KIND") && error.contains("power-cycle"), "{error}");
        }
        assert!("unplug@NOWHERE".parse::<Fault>().is_err());
    }

    #[test]
    fn a_fault_strikes_at_its_request_and_only_lasting_ones_stay() {
        let mut faults = Faults::new(vec!["lost-reply@PTP#2".parse().unwrap()]);
        assert!(faults.strike(id::PTP).is_empty());
        assert!(faults.strike(id::POSE).is_empty());
        assert_eq!(faults.strike(id::PTP), [FaultKind::LostReply]);
        assert!(faults.strike(id::PTP).is_empty());
        faults.add("silence@2".parse().unwrap());
        assert!(faults.strike(1).is_empty());
        assert_eq!(faults.strike(1), [FaultKind::Silence]);
        assert_eq!(faults.strike(1), [FaultKind::Silence]);
    }
}
