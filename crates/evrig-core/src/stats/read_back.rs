//! Reading results back from JSON, which has no NaN.

use serde::de::value::{MapDeserializer, SeqDeserializer};
use serde::de::{DeserializeOwned, Deserializer, IntoDeserializer, Visitor};
use serde::forward_to_deserialize_any;
use serde_json::{Error, Value};

/// Reads a result that was written as JSON. An unknown number is `null` there and NaN here, as it
/// was before; where it is an `Option`, it is none. Inside of enums and of what is flattened a
/// number has to be known.
///
/// # Errors
/// When the text is no JSON, or not of this result.
pub fn read_back<T: DeserializeOwned>(text: &str) -> Result<T, Error> {
    read_value(serde_json::from_str(text)?)
}

/// As [`read_back`], of a value that was parsed already.
///
/// # Errors
/// When the value is not of this result.
pub fn read_value<T: DeserializeOwned>(value: Value) -> Result<T, Error> {
    T::deserialize(Back(value))
}

/// A value in which `null` is read as NaN where a number is expected.
struct Back(Value);

impl<'de> IntoDeserializer<'de, Error> for Back {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for Back {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        match self.0 {
            Value::Array(values) => {
                let mut values = SeqDeserializer::new(values.into_iter().map(Back));
                let read = visitor.visit_seq(&mut values)?;
                values.end().map(|()| read)
            }
            Value::Object(members) => {
                let members = members.into_iter().map(|(key, value)| (key, Back(value)));
                let mut members = MapDeserializer::new(members);
                let read = visitor.visit_map(&mut members)?;
                members.end().map(|()| read)
            }
            plain => plain.deserialize_any(visitor),
        }
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        if self.0.is_null() { visitor.visit_f64(f64::NAN) } else { self.0.deserialize_f64(visitor) }
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        self.deserialize_f64(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        if self.0.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.0.deserialize_enum(name, variants, visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 char str string bytes byte_buf unit unit_struct seq
        tuple tuple_struct map struct identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::{Deserialize, Serialize};
    use std::collections::BTreeMap;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    enum Kind {
        Plain,
        With { share: f64 },
    }

    #[derive(Debug, Serialize, Deserialize)]
    struct Wrapped(f64);

    #[derive(Debug, Serialize, Deserialize)]
    struct Curve {
        per_decade: Vec<f64>,
        dispersion: f64,
        small: f32,
        ends: [f64; 2],
        error: Option<f64>,
        wrapped: Wrapped,
        by_name: BTreeMap<String, Option<Vec<f64>>>,
        kinds: Vec<Kind>,
        n: u64,
        #[serde(default)]
        later: Option<String>,
    }

    fn curve() -> Curve {
        Curve {
            per_decade: vec![1.5, f64::NAN, f64::INFINITY],
            dispersion: f64::NAN,
            small: f32::NAN,
            ends: [f64::NEG_INFINITY, 0.1],
            error: None,
            wrapped: Wrapped(f64::NAN),
            by_name: [("a".into(), Some(vec![f64::NAN, 2.0])), ("b".into(), None)].into(),
            kinds: vec![Kind::Plain, Kind::With { share: 0.25 }],
            n: u64::MAX,
            later: Some("x".into()),
        }
    }

    #[test]
    fn what_is_not_known_goes_through_json_and_comes_back() {
        let text = serde_json::to_string(&curve()).unwrap();
        assert!(serde_json::from_str::<Curve>(&text).is_err(), "JSON has no word for it");
        let back: Curve = read_back(&text).unwrap();
        assert_eq!(back.per_decade[0], 1.5);
        assert!(back.per_decade[1..].iter().all(|v| v.is_nan()));
        assert!(back.dispersion.is_nan() && back.small.is_nan() && back.wrapped.0.is_nan());
        assert!(back.ends[0].is_nan() && back.ends[1] == 0.1);
        assert_eq!((back.error, back.n, back.later.as_deref()), (None, u64::MAX, Some("x")));
        let a = back.by_name["a"].as_ref().unwrap();
        assert!(a[0].is_nan() && a[1] == 2.0 && back.by_name["b"].is_none());
        assert_eq!(back.kinds, curve().kinds);
        let value: Curve = read_value(serde_json::to_value(curve()).unwrap()).unwrap();
        assert!(value.dispersion.is_nan() && value.n == u64::MAX);
    }

    #[test]
    fn what_is_something_else_is_refused() {
        let text = serde_json::to_string(&curve()).unwrap();
        let refused = [
            ("1.5", "\"x\"", "expected f64"),
            ("0.1]", "0.1,3.0]", "expected"),
            ("18446744073709551615", "null", "expected u64"),
            ("\"Plain\"", "\"Plane\"", "unknown variant"),
            ("\"dispersion\"", "\"dispersal\"", "missing field"),
            ("}", "", "EOF"),
        ];
        for (here, other, why) in refused {
            let error = read_back::<Curve>(&text.replacen(here, other, 1)).unwrap_err().to_string();
            assert!(error.contains(why), "{here}: {error}");
        }
    }
}
