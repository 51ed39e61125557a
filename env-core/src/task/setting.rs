//! Settings as a table: name, value, bounds, unit and meaning of each, from which input is read and
//! checked, and documentation is made.

use serde_json::{Value, json};

use crate::{Error, Result};

/// Lower and upper end of a uniform draw.
pub type Range = [f64; 2];

/// Value of a setting.
#[derive(Debug)]
pub enum SettingValue<'a> {
    /// One number.
    Number(&'a mut f64),
    /// One whole number.
    Count(&'a mut u32),
    /// Both ends of a uniform draw, which may be equal.
    Range(&'a mut Range),
}

/// One numeric setting of a task, or of all tasks.
#[derive(Debug)]
pub struct Setting<'a> {
    /// Name of the keyword argument.
    pub name: &'static str,
    /// Its value.
    pub value: SettingValue<'a>,
    /// Least and greatest allowed value.
    pub bounds: [f64; 2],
    /// SI unit; empty for a ratio.
    pub unit: &'static str,
    /// Meaning, as a phrase.
    pub doc: &'static str,
}

impl<'a> Setting<'a> {
    /// A setting that is one number.
    pub fn number(
        name: &'static str,
        value: &'a mut f64,
        bounds: Range,
        unit: &'static str,
        doc: &'static str,
    ) -> Self {
        Self { name, value: SettingValue::Number(value), bounds, unit, doc }
    }

    /// A setting that is a whole number.
    pub fn count(
        name: &'static str,
        value: &'a mut u32,
        bounds: [u32; 2],
        unit: &'static str,
        doc: &'static str,
    ) -> Self {
        let bounds = bounds.map(f64::from);
        Self { name, value: SettingValue::Count(value), bounds, unit, doc }
    }

    /// A setting that is a range to draw from.
    pub fn range(
        name: &'static str,
        value: &'a mut Range,
        bounds: Range,
        unit: &'static str,
        doc: &'static str,
    ) -> Self {
        Self { name, value: SettingValue::Range(value), bounds, unit, doc }
    }

    /// Sets the value from JSON: a number, or for a range also its two ends. The bounds of a count
    /// are checked here, those of others by [`Setting::validate`].
    pub fn set(&mut self, value: &Value) -> Result<()> {
        match &mut self.value {
            SettingValue::Number(number) => {
                let given = value.as_f64();
                **number = given.ok_or_else(|| Error::invalid(self.name, value, "a number"))?;
            }
            SettingValue::Count(count) => {
                let [low, high] = self.bounds;
                let given = value.as_u64().and_then(|given| u32::try_from(given).ok());
                let given = given.filter(|&given| (low..=high).contains(&f64::from(given)));
                let expected = || format!("a whole number from {low} to {high}");
                **count = given.ok_or_else(|| Error::invalid(self.name, value, expected()))?;
            }
            SettingValue::Range(range) => {
                let given = range_of(value);
                **range = given.ok_or_else(|| Error::invalid(self.name, value, RANGE))?;
            }
        }
        Ok(())
    }

    /// Both ends of the value.
    fn ends(&self) -> Range {
        match &self.value {
            SettingValue::Number(number) => [**number; 2],
            SettingValue::Count(count) => [f64::from(**count); 2],
            SettingValue::Range(range) => **range,
        }
    }

    /// Returns an error unless the value is within its bounds, and a range is rising.
    pub fn validate(&self) -> Result<()> {
        rising(self.name, self.ends(), self.bounds)
    }

    /// Description for other languages; the present value is given as the default.
    pub(super) fn describe(&self) -> Value {
        let default = match &self.value {
            SettingValue::Number(number) => json!(**number),
            SettingValue::Count(count) => json!(**count),
            SettingValue::Range(range) => json!(**range),
        };
        let kind = match self.value {
            SettingValue::Number(_) => "number",
            SettingValue::Count(_) => "count",
            SettingValue::Range(_) => "range",
        };
        let Self { name, bounds, unit, doc, .. } = self;
        json!({"name": name, "kind": kind, "default": default, "bounds": bounds, "unit": unit, "doc": doc})
    }
}

/// Description of the values that [`range_of`] accepts.
pub(super) const RANGE: &str = "a number or a range of two numbers";

/// Reads a number, which stands for both ends, or the two ends of a range.
pub(super) fn range_of(value: &Value) -> Option<Range> {
    match value.as_array().map(Vec::as_slice) {
        Some([low, high]) => Some([low.as_f64()?, high.as_f64()?]),
        Some(_) => None,
        None => value.as_f64().map(|x| [x, x]),
    }
}

/// Returns an error unless `range` is rising and within `bounds`.
pub(super) fn rising(name: &str, range: Range, bounds: Range) -> Result<()> {
    let ([from, to], [low, high]) = (range, bounds);
    if low <= from && from <= to && to <= high {
        return Ok(());
    }
    let found = if from == to { format!("{from}") } else { format!("{range:?}") };
    Err(Error::invalid(name, found, format!("a rising range within {low} to {high}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_takes_a_number_or_two_and_a_number_only_one() {
        let (mut one, mut two) = (0.0, [0.0; 2]);
        let mut number = Setting::number("limit", &mut one, [0.0, 1.0], "m", "a limit");
        let mut range = Setting::range("mass", &mut two, [0.0, 1.0], "kg", "a mass");
        number.set(&json!(0.5)).unwrap();
        range.set(&json!(2)).unwrap();
        assert_eq!((number.ends(), range.ends()), ([0.5; 2], [2.0; 2]));
        assert!(number.validate().is_ok());
        let message = range.validate().unwrap_err().to_string();
        assert_eq!(message, "mass: found 2, expected a rising range within 0 to 1");
        range.set(&json!([0.25, 1])).unwrap();
        assert!(range.validate().is_ok());
        for wrong in [json!("heavy"), json!([1]), json!([1, "a"]), json!(null), json!({})] {
            let message = range.set(&wrong).unwrap_err().to_string();
            assert!(message.starts_with("mass: found") && message.contains("a range"), "{message}");
        }
        assert!(number.set(&json!([0.1, 0.2])).is_err());
    }

    #[test]
    fn a_count_takes_whole_numbers_within_its_bounds_alone() {
        let mut three = 3;
        let mut count = Setting::count("things", &mut three, [0, 4], "", "some things");
        for wrong in [json!(-1), json!(5), json!(1.5), json!(true), json!([1]), json!(1e30)] {
            let message = count.set(&wrong).unwrap_err().to_string();
            let expected = "expected a whole number from 0 to 4";
            assert_eq!(message, format!("things: found {wrong}, {expected}"));
        }
        count.set(&json!(4)).unwrap();
        assert!(count.validate().is_ok());
        assert_eq!(three, 4);
    }
}
