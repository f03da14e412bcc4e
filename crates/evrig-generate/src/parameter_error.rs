//! Why a description of a generator is refused.

/// A generator's description that does not make sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParameterError {
    /// A k outside its range.
    #[error("k{number} is {value}; expected {low} to {high} ({unit})")]
    KOutOfRange {
        /// 1 to 6.
        number: usize,
        /// What was given.
        value: f64,
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
        /// Unit of the range.
        unit: &'static str,
    },
    /// Not six numbers.
    #[error("`{text}` holds {found} numbers; expected six, as k1,k2,k3,k4,k5,k6")]
    KCount {
        /// How many were given.
        found: usize,
        /// The text.
        text: String,
    },
    /// A k that is not a number.
    #[error("k{number} is `{text}`, which is not a number; write it as 2.388 or 9.8e-8")]
    KNotANumber {
        /// 1 to 6.
        number: usize,
        /// The text.
        text: String,
    },
    /// A parameter of another model outside its range.
    #[error("{name} is {value}; expected {low} to {high}")]
    OutOfRange {
        /// The parameter as it is called in files.
        name: &'static str,
        /// What was given.
        value: f64,
        /// Lowest value.
        low: f64,
        /// Highest value.
        high: f64,
    },
    /// A knob's setting that cannot be read.
    #[error("`{text}` is not a knob's setting; write it as name=value, as in global-noise=1e-5")]
    NotASetting {
        /// The text.
        text: String,
    },
    /// A name that nothing has.
    #[error("no {kind} is called `{name}`{hint}; there are {known}")]
    UnknownName {
        /// What was looked for: model, law, preset, knob.
        kind: &'static str,
        /// The name given.
        name: String,
        /// "; did you mean ..." or nothing.
        hint: String,
        /// All names.
        known: String,
    },
    /// Two sources of the same numbers.
    #[error("a preset and k are both given; give one of the two")]
    PresetAndK,
    /// A setting of another model.
    #[error("{given} does not go with the model {model}; leave it out or choose another model")]
    NotForModel {
        /// What was given: a preset, k, a law, a knob.
        given: String,
        /// The model.
        model: &'static str,
    },
    /// The pool of threads did not start.
    #[error("{threads} threads could not be started: {reason}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// The system's error.
        reason: String,
    },
}

/// Refuses a value that is not within `low..=high`.
pub(super) fn check(
    name: &'static str,
    value: f64,
    low: f64,
    high: f64,
) -> Result<(), ParameterError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(ParameterError::OutOfRange { name, value, low, high })
    }
}

impl ParameterError {
    /// A name that is none of `names`, with the most similar one as a hint.
    pub(super) fn unknown(kind: &'static str, name: &str, names: &[&str]) -> Self {
        let lower = name.to_lowercase();
        let hint = names
            .iter()
            .map(|known| (strsim::jaro_winkler(&lower, &known.to_lowercase()), known))
            .filter(|(similarity, _)| *similarity > 0.75)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or_else(String::new, |(_, known)| format!("; did you mean `{known}`?"));
        let known = names.join(", ");
        Self::UnknownName { kind, name: name.to_owned(), hint, known }
    }
}

/// Reads and writes an enum with `ALL` and `name()` by its names, in any case.
macro_rules! named {
    ($name:ident, $kind:literal) => {
        impl std::str::FromStr for $name {
            type Err = $crate::parameter_error::ParameterError;
            fn from_str(text: &str) -> Result<Self, $crate::parameter_error::ParameterError> {
                Self::ALL
                    .into_iter()
                    .find(|item| item.name().eq_ignore_ascii_case(text))
                    .ok_or_else(|| {
                        $crate::parameter_error::ParameterError::unknown(
                            $kind,
                            text,
                            &Self::ALL.map(Self::name),
                        )
                    })
            }
        }
        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}
