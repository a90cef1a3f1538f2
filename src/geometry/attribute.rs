//! Numbers that points or vertices have besides their positions: colours, intensities, classes.

/// The type that numbers have in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Number {
    /// A signed integer of 8 bits.
    I8,
    /// An unsigned integer of 8 bits.
    U8,
    /// A signed integer of 16 bits.
    I16,
    /// An unsigned integer of 16 bits.
    U16,
    /// A signed integer of 32 bits.
    I32,
    /// An unsigned integer of 32 bits.
    U32,
    /// A floating point number of 32 bits.
    F32,
    /// A floating point number of 64 bits.
    F64,
}

impl Number {
    /// A short name, such as `u16` or `f32`.
    pub fn name(self) -> &'static str {
        match self {
            Number::I8 => "i8",
            Number::U8 => "u8",
            Number::I16 => "i16",
            Number::U16 => "u16",
            Number::I32 => "i32",
            Number::U32 => "u32",
            Number::F32 => "f32",
            Number::F64 => "f64",
        }
    }
}

/// One number a point or vertex, with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Attribute {
    /// The name in the file.
    pub name: String,
    /// The type in the file; all its values are exact in 64-bit floats.
    pub number: Number,
    /// The values, n, in the order of the points. Only floats may be not finite: then there is no value.
    pub values: Vec<f64>,
}

/// The names of the parts of a colour.
pub(crate) const COLOUR: [&str; 3] = ["red", "green", "blue"];

impl Attribute {
    /// Whether this is a part of a colour: `red`, `green` or `blue`.
    pub fn is_colour(&self) -> bool {
        COLOUR.contains(&self.name.as_str())
    }

    /// The least and the largest of its values that are numbers; `None` if none is.
    pub fn range(&self) -> Option<[f64; 2]> {
        let numbers = self.values.iter().filter(|x| !x.is_nan());
        numbers.fold(None, |range: Option<[f64; 2]>, &x| {
            Some(range.map_or([x, x], |[low, high]| [low.min(x), high.max(x)]))
        })
    }

    /// The attribute of other places: at each the value of the point of this number.
    ///
    /// # Panics
    /// If there is no such point.
    #[track_caller]
    pub fn picked(&self, points: &[u32]) -> Attribute {
        Attribute { values: points.iter().map(|&i| self.values[i as usize]).collect(), ..self.clone() }
    }
}

/// The colours of n places, each part from 0 to 1, if `red`, `green` and `blue` are all there. Bytes are parts of 255
/// and 16-bit integers of 65,535; floats and other integers are taken as they are, or as parts of 255 if one of them is
/// above 1.
pub(crate) fn colours(attributes: &[Attribute]) -> Option<Vec<[f32; 3]>> {
    let named = |name: &str| attributes.iter().find(|a| a.name == name);
    let parts = [named(COLOUR[0])?, named(COLOUR[1])?, named(COLOUR[2])?];
    let largest = parts.iter().flat_map(|a| &a.values).fold(0.0, |m: f64, &x| m.max(x));
    let whole = |a: &Attribute| match a.number {
        Number::U8 => 255.0,
        Number::U16 => 65_535.0,
        _ if largest > 1.0 => 255.0,
        _ => 1.0,
    };
    // Without a value it is black.
    let part = |a: &Attribute, i: usize| {
        let share = a.values[i] / whole(a);
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) as f32 }
    };
    Some((0..parts[0].values.len()).map(|i| parts.map(|a| part(a, i))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attribute(name: &str, number: Number, values: &[f64]) -> Attribute {
        Attribute { name: name.into(), number, values: values.to_vec() }
    }

    #[test]
    fn colours_are_shares_whatever_type_holds_them() {
        let of = |number, values: [f64; 3]| {
            let all: Vec<Attribute> =
                COLOUR.iter().zip(values).map(|(name, x)| attribute(name, number, &[x])).collect();
            assert!(colours(&all[1..]).is_none());
            colours(&all).unwrap()[0]
        };
        assert_eq!(of(Number::U8, [0.0, 51.0, 255.0]), [0.0, 0.2, 1.0]);
        assert_eq!(of(Number::U8, [0.0, 1.0, 0.0]), [0.0, 1.0 / 255.0, 0.0]);
        assert_eq!(of(Number::U16, [65_535.0, 13_107.0, 0.0]), [1.0, 0.2, 0.0]);
        assert_eq!(of(Number::F32, [0.25, 0.5, 1.0]), [0.25, 0.5, 1.0]);
        assert_eq!(of(Number::F32, [51.0, -3.0, f64::NAN]), [0.2, 0.0, 0.0]);
    }

    #[test]
    fn the_range_is_that_of_the_numbers() {
        let of = |values: &[f64]| attribute("a", Number::F32, values).range();
        assert_eq!(of(&[2.0, f64::NAN, -1.5, 0.0]), Some([-1.5, 2.0]));
        assert_eq!((of(&[]), of(&[f64::NAN])), (None, None));
        assert_eq!(Number::U16.name(), "u16");
    }

    #[test]
    fn places_take_the_values_of_their_points() {
        let class = attribute("class", Number::U8, &[2.0, 6.0, 9.0]);
        assert_eq!(class.picked(&[2, 0, 0]), attribute("class", Number::U8, &[9.0, 2.0, 2.0]));
        assert!(!class.is_colour() && attribute("green", Number::F32, &[]).is_colour());
    }
}
