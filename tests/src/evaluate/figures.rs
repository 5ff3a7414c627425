//! Numbers with keys, in the order they were measured.

use serde::ser::{Serialize, SerializeMap as _, Serializer};

/// Measured numbers by key, in the order they were set. Invariant: every key once, every number finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures(Vec<(String, f64)>);

/// Why a figure cannot be kept: a mistake of the suite, or a measurement that has no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FigureError {
    /// JSON has no such numbers, and no reader expects them.
    #[error("figure {key} is {value}: leave out what was not measured")]
    NotFinite {
        /// The figure's key.
        key: String,
        /// Its value.
        value: f64,
    },
    /// Two values for one key: which is it?
    #[error(
        "figure {key} is {first} and also {second}: give each case, method and metric a name of its own"
    )]
    Twice {
        /// The figure's key.
        key: String,
        /// The value it has.
        first: f64,
        /// The value it was to get.
        second: f64,
    },
}

impl Figures {
    /// Keeps `value` under the parts of its key, as `["residential", "tandem", "f1"]`, joined by slashes.
    pub fn set(&mut self, key: &[&str], value: f64) -> Result<(), FigureError> {
        let key = key.join("/");
        if !value.is_finite() {
            return Err(FigureError::NotFinite { key, value });
        }
        if let Some(first) = self.get(&key) {
            return Err(FigureError::Twice {
                key,
                first,
                second: value,
            });
        }
        self.0.push((key, value));
        Ok(())
    }

    /// The number under a whole key.
    pub fn get(&self, key: &str) -> Option<f64> {
        self.iter()
            .find_map(|(known, value)| (known == key).then_some(value))
    }

    /// All of them, in order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(key, value)| (key.as_str(), *value))
    }
}

/// One JSON object.
impl Serialize for Figures {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (key, value) in self.iter() {
            map.serialize_entry(key, &value)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_or_comes_twice_is_refused() {
        let mut figures = Figures::default();
        figures.set(&["a", "b"], 1.0).expect("new");
        let twice = figures.set(&["a", "b"], 2.0).expect_err("there is one");
        assert_eq!(
            twice.to_string(),
            "figure a/b is 1 and also 2: give each case, method and metric a name of its own"
        );
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let error = figures.set(&["c"], value).expect_err("JSON has none");
            assert!(matches!(error, FigureError::NotFinite { .. }), "{error}");
        }
        assert_eq!(figures.iter().collect::<Vec<_>>(), [("a/b", 1.0)]);
    }
}
