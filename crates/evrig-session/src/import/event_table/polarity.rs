//! Which values of the polarity mean ON and OFF.

use super::column_values::first_distinct;
use evrig_format::npy::Column;
use std::str::FromStr;

/// The two values of a polarity, given by the user as `ON,OFF`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PolarityRule {
    on: i64,
    off: i64,
}

impl FromStr for PolarityRule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = |(on, off): (&str, &str)| {
            Some(Self { on: on.trim().parse().ok()?, off: off.trim().parse().ok()? })
        };
        let rule = text.split_once(',').and_then(parse).filter(|rule| rule.on != rule.off);
        rule.ok_or_else(|| "expected the values of ON and OFF, as 1,0 or 1,-1".to_owned())
    }
}

/// -1 stored in unsigned integers of 8, 16, 32 and 64 bits.
const WRAPPED_MINUS_ONE: [i64; 4] = [255, 65_535, 4_294_967_295, i64::MAX];

/// Whether a value belongs to a convention.
pub(super) fn is_known(value: f64) -> bool {
    matches!(value, -1.0 | 0.0 | 1.0)
        || WRAPPED_MINUS_ONE.iter().any(|known| *known as f64 == value)
}

/// Whether each event is ON, and the convention that was found.
///
/// # Errors
/// When a value is of no convention, or two conventions fit.
pub(super) fn decide(
    column: Column,
    rule: Option<PolarityRule>,
) -> Result<(Vec<bool>, String), String> {
    if let Column::Float(values) = &column
        && let Some(i) = values.iter().position(|value| value.fract() != 0.0)
    {
        return Err(format!("event {i} has polarity {}; expected 1 and 0, or 1 and -1", values[i]));
    }
    match column {
        Column::Short(values) => by_rule(&values, rule),
        wide => {
            let values = wide.into_integers().map_err(|i| format!("event {i} has no polarity"))?;
            by_rule(&values, rule)
        }
    }
}

fn by_rule<T: Copy + PartialEq + Into<i64> + TryFrom<i64>>(
    values: &[T],
    stated: Option<PolarityRule>,
) -> Result<(Vec<bool>, String), String> {
    const REMEDY: &str = "state the values of ON and OFF with --polarity, as 1,0";
    let rule = match stated {
        Some(rule) => rule,
        None => {
            let mut distinct: Vec<i64> =
                first_distinct::<_, 3>(values).into_iter().map(T::into).collect();
            distinct.sort_unstable();
            let is_wrapped = |value: &i64| WRAPPED_MINUS_ONE.contains(value);
            match distinct.as_slice() {
                [] | [0] | [0, 1] | [1] => PolarityRule { on: 1, off: 0 },
                [-1] | [-1, 1] => PolarityRule { on: 1, off: -1 },
                [off] | [1, off] if is_wrapped(off) => PolarityRule { on: 1, off: *off },
                _ => {
                    let other = values.iter().position(|v| !matches!((*v).into(), 0 | 1));
                    let i = other.unwrap_or(0);
                    return Err(format!(
                        "event {i} has polarity {} and the values begin with {distinct:?}; \
                         expected 1 and 0, or 1 and -1; {REMEDY}",
                        values[i].into()
                    ));
                }
            }
        }
    };
    // A value that the column cannot hold is none of its values.
    let [is_on, is_off] = [rule.on, rule.off].map(|known| {
        let known = T::try_from(known).ok();
        move |value: &T| known.is_some_and(|known| *value == known)
    });
    let on: Vec<bool> = values.iter().map(is_on).collect();
    let n_on = on.iter().filter(|on| **on).count();
    if n_on + values.iter().filter(|value| is_off(value)).count() < values.len()
        && let Some(i) = values.iter().position(|value| !is_on(value) && !is_off(value))
    {
        return Err(format!(
            "event {i} has polarity {}; expected {} for ON or {} for OFF; {REMEDY}",
            values[i].into(),
            rule.on,
            rule.off
        ));
    }
    let place = if stated.is_some() { " (--polarity)" } else { "" };
    let decision = format!(
        "polarity {} is ON and {} is OFF{place}: {n_on} ON, {} OFF",
        rule.on,
        rule.off,
        on.len() - n_on
    );
    Ok((on, decision))
}
