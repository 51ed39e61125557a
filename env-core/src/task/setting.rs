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
                **number = given.ok_or_else(|| Error::invalid(self.name, value, "one number"))?;
            }
            SettingValue::Count(count) => {
                let given = value.as_u64().and_then(|given| u32::try_from(given).ok());
                let expected = || whole(self.bounds);
                let given = given.ok_or_else(|| Error::invalid(self.name, value, expected()))?;
                whole_within(self.name, f64::from(given), self.bounds)?;
                **count = given;
            }
            SettingValue::Range(range) => {
                let given = range_of(value);
                **range = given.ok_or_else(|| Error::invalid(self.name, value, RANGE))?;
            }
        }
        Ok(())
    }

    /// Returns an error unless the value is within its bounds, and a range is rising.
    pub fn validate(&self) -> Result<()> {
        match &self.value {
            SettingValue::Number(number) => within(self.name, **number, self.bounds),
            SettingValue::Count(count) => whole_within(self.name, f64::from(**count), self.bounds),
            SettingValue::Range(range) => rising(self.name, **range, self.bounds),
        }
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
pub(super) const RANGE: &str = "one number or a rising range [low, high]";

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
    Err(Error::invalid(name, found, format!("{RANGE} within {low} to {high}")))
}

/// Returns an error unless `number` is within `bounds`.
pub(super) fn within(name: &str, number: f64, bounds: Range) -> Result<()> {
    let [low, high] = bounds;
    if (low..=high).contains(&number) {
        return Ok(());
    }
    Err(Error::invalid(name, number, format!("one number from {low} to {high}")))
}

/// Returns an error unless the whole number `count` is within `bounds`.
pub(super) fn whole_within(name: &str, count: f64, bounds: Range) -> Result<()> {
    if (bounds[0]..=bounds[1]).contains(&count) {
        return Ok(());
    }
    Err(Error::invalid(name, count, whole(bounds)))
}

fn whole([low, high]: Range) -> String {
    format!("a whole number from {low} to {high}")
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
        assert!(number.validate().is_ok());
        let message = range.validate().unwrap_err().to_string();
        let expected = "expected one number or a rising range [low, high] within 0 to 1";
        assert_eq!(message, format!("mass: found 2, {expected}"));
        range.set(&json!([0.25, 1])).unwrap();
        assert!(range.validate().is_ok());
        for wrong in [json!("heavy"), json!([1]), json!([1, "a"]), json!(null), json!({})] {
            let message = range.set(&wrong).unwrap_err().to_string();
            let expected = "expected one number or a rising range [low, high]";
            assert_eq!(message, format!("mass: found {wrong}, {expected}"));
        }
        let message = number.set(&json!([0.1, 0.2])).unwrap_err().to_string();
        assert_eq!(message, "limit: found [0.1,0.2], expected one number");
        number.set(&json!(1.5)).unwrap();
        let message = number.validate().unwrap_err().to_string();
        assert_eq!(message, "limit: found 1.5, expected one number from 0 to 1");
        assert_eq!((one, two), (1.5, [0.25, 1.0]));
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
