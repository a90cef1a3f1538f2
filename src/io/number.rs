//! Numbers as the bytes of a file hold them: their types, and the way to 64-bit floats and back.

use crate::geometry::Number;

/// The order of the bytes of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    /// The byte of the lowest digits first.
    Little,
    /// The byte of the highest digits first.
    Big,
}

/// The type of a number in a binary file: signed (`I`) and unsigned (`U`) integers and floats (`F`) of so many bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumberType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl NumberType {
    /// The integer, signed or not, of 1, 2, 4 or 8 bytes.
    pub fn integer(size: usize, signed: bool) -> Option<NumberType> {
        Some(match (size, signed) {
            (1, true) => NumberType::I8,
            (1, false) => NumberType::U8,
            (2, true) => NumberType::I16,
            (2, false) => NumberType::U16,
            (4, true) => NumberType::I32,
            (4, false) => NumberType::U32,
            (8, true) => NumberType::I64,
            (8, false) => NumberType::U64,
            _ => return None,
        })
    }

    /// The bytes that it takes.
    pub fn size(self) -> usize {
        match self {
            NumberType::I8 | NumberType::U8 => 1,
            NumberType::I16 | NumberType::U16 | NumberType::F16 => 2,
            NumberType::I32 | NumberType::U32 | NumberType::F32 => 4,
            NumberType::I64 | NumberType::U64 | NumberType::F64 => 8,
        }
    }

    /// The value of the number at the beginning of `bytes`. Integers of 64 bits are rounded to the nearest float.
    ///
    /// # Panics
    ///
    /// If there are fewer bytes than the number takes.
    pub fn read(self, bytes: &[u8], order: ByteOrder) -> f64 {
        let size = self.size();
        let mut word = [0; 8];
        word[..size].copy_from_slice(&bytes[..size]);
        if order == ByteOrder::Big {
            word[..size].reverse();
        }
        let bits = u64::from_le_bytes(word);
        match self {
            NumberType::I8 => f64::from(bits as i8),
            NumberType::I16 => f64::from(bits as i16),
            NumberType::I32 => f64::from(bits as i32),
            NumberType::I64 => bits as i64 as f64,
            NumberType::U8 | NumberType::U16 | NumberType::U32 | NumberType::U64 => bits as f64,
            NumberType::F16 => half(bits as u16),
            NumberType::F32 => f64::from(f32::from_bits(bits as u32)),
            NumberType::F64 => f64::from_bits(bits),
        }
    }

    /// The type of an attribute that holds such numbers. Floats of 16 bits become floats of 32 bits, and integers of 64
    /// bits, which 64-bit floats may have rounded, become such floats.
    pub fn kept_as(self) -> Number {
        match self {
            NumberType::I8 => Number::I8,
            NumberType::U8 => Number::U8,
            NumberType::I16 => Number::I16,
            NumberType::U16 => Number::U16,
            NumberType::I32 => Number::I32,
            NumberType::U32 => Number::U32,
            NumberType::F16 | NumberType::F32 => Number::F32,
            NumberType::I64 | NumberType::U64 | NumberType::F64 => Number::F64,
        }
    }
}

/// The little-endian unsigned integer of `size` bytes (at most 8) at the place `at`, if so many bytes are there.
pub(super) fn unsigned(bytes: &[u8], at: usize, size: usize) -> Option<u64> {
    let part = bytes.get(at..at.checked_add(size)?)?;
    Some(part.iter().rev().fold(0, |all, b| all << 8 | u64::from(*b)))
}

/// Adds the bytes of a number to `out`; what an integer cannot hold becomes the nearest that it can.
pub(super) fn append(out: &mut Vec<u8>, x: f64, number: Number, order: ByteOrder) {
    let start = out.len();
    match number {
        Number::I8 => out.extend((x as i8).to_le_bytes()),
        Number::U8 => out.push(x as u8),
        Number::I16 => out.extend((x as i16).to_le_bytes()),
        Number::U16 => out.extend((x as u16).to_le_bytes()),
        Number::I32 => out.extend((x as i32).to_le_bytes()),
        Number::U32 => out.extend((x as u32).to_le_bytes()),
        Number::F32 => out.extend((x as f32).to_le_bytes()),
        Number::F64 => out.extend(x.to_le_bytes()),
    }
    if order == ByteOrder::Big {
        out[start..].reverse();
    }
}

/// A float of 16 bits: 1 bit of sign, 5 of exponent, 10 of fraction.
fn half(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from(bits >> 10 & 0x1f);
    let fraction = f64::from(bits & 0x3ff);
    sign * match exponent {
        0 => fraction * f64::powi(2.0, -24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * f64::powi(2.0, exponent - 25),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORDERS: [ByteOrder; 2] = [ByteOrder::Little, ByteOrder::Big];

    /// Bytes of every type, little-endian, and what they mean.
    #[test]
    fn bytes_of_every_type_have_their_value_in_both_orders() {
        let cases: [(NumberType, &[u8], f64); 17] = [
            (NumberType::I8, &[0x80], -128.0),
            (NumberType::I8, &[0x7f], 127.0),
            (NumberType::U8, &[0xff], 255.0),
            (NumberType::I16, &[0xfe, 0xff], -2.0),
            (NumberType::I16, &[0x2c, 0x01], 300.0),
            (NumberType::U16, &[0xfe, 0xff], 65_534.0),
            (NumberType::I32, &(-2_000_000_000_i32).to_le_bytes(), -2e9),
            (NumberType::U32, &4_000_000_000_u32.to_le_bytes(), 4e9),
            (NumberType::I64, &i64::MIN.to_le_bytes(), -9_223_372_036_854_775_808.0),
            (NumberType::I64, &((1_i64 << 53) + 1).to_le_bytes(), 9_007_199_254_740_992.0),
            (NumberType::U64, &u64::MAX.to_le_bytes(), 18_446_744_073_709_551_616.0),
            (NumberType::F16, &[0x00, 0xc0], -2.0),
            (NumberType::F32, &0.1_f32.to_le_bytes(), 0.1_f32 as f64),
            (NumberType::F32, &(-0.0_f32).to_le_bytes(), -0.0),
            (NumberType::F32, &f32::NEG_INFINITY.to_le_bytes(), f64::NEG_INFINITY),
            (NumberType::F64, &(-1e300_f64).to_le_bytes(), -1e300),
            (NumberType::F64, &5e-324_f64.to_le_bytes(), 5e-324),
        ];
        for (number, little, value) in cases {
            assert_eq!(number.size(), little.len());
            let big: Vec<u8> = little.iter().rev().copied().collect();
            for (order, bytes) in ORDERS.into_iter().zip([little, &big]) {
                // What stands behind the number does not matter.
                let bytes = [bytes, &[0xa5; 9]].concat();
                let read = number.read(&bytes, order);
                assert_eq!(read.to_bits(), value.to_bits(), "{number:?} {order:?}: {read}");
            }
        }
        assert!(NumberType::F32.read(&f32::NAN.to_le_bytes(), ByteOrder::Little).is_nan());
    }

    #[test]
    fn attributes_come_back_from_their_bytes() {
        let cases = [
            (NumberType::I8, [-128.0, 127.0, 0.0]),
            (NumberType::U8, [255.0, 0.0, 1.0]),
            (NumberType::I16, [-32_768.0, 32_767.0, 6.0]),
            (NumberType::U16, [65_535.0, 5.0, 6.0]),
            (NumberType::I32, [-2e9, 5.0, 6.0]),
            (NumberType::U32, [4e9, 5.0, 6.0]),
            (NumberType::F32, [0.5, -0.25, f64::INFINITY]),
            (NumberType::F64, [1e300, 0.1, -7.0]),
        ];
        for (number, values) in cases {
            for (x, order) in values.into_iter().flat_map(|x| ORDERS.map(|order| (x, order))) {
                let mut bytes = vec![7];
                append(&mut bytes, x, number.kept_as(), order);
                assert_eq!((bytes.len(), bytes[0]), (1 + number.size(), 7));
                assert_eq!(number.read(&bytes[1..], order), x, "{number:?} {order:?}");
            }
        }
        let mut bytes = Vec::new();
        [300.0, -1.0].iter().for_each(|&x| append(&mut bytes, x, Number::U8, ByteOrder::Little));
        assert_eq!(bytes, [255, 0]);
    }

    #[test]
    fn integers_are_known_by_their_size() {
        for size in 0..=9 {
            for signed in [false, true] {
                let number = NumberType::integer(size, signed);
                assert_eq!(number.map(NumberType::size), [1, 2, 4, 8].contains(&size).then_some(size));
                let negative = number.is_some_and(|n| n.read(&[0xff; 8], ByteOrder::Big) < 0.0);
                assert_eq!(negative, number.is_some() && signed);
            }
        }
    }

    #[test]
    fn unsigned_integers_are_read_where_they_are_whole() {
        let bytes = [1, 2, 3, 4, 5, 6, 7, 8, 9];
        assert_eq!(unsigned(&bytes, 1, 2), Some(0x0302));
        assert_eq!(unsigned(&bytes, 1, 8), Some(0x0908_0706_0504_0302));
        assert_eq!(unsigned(&bytes, 2, 8), None);
        assert_eq!(unsigned(&bytes, usize::MAX, 4), None);
        assert_eq!(unsigned(&bytes, 9, 0), Some(0));
    }

    #[test]
    fn halves_of_every_kind() {
        let cases = [
            (0x0000, 0.0),
            (0x8000, -0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333_251_953_125),
            (0x7bff, 65_504.0),
            (0x0001, 5.960_464_477_539_063e-8),
            (0x0400, 6.103_515_625e-5),
            (0x7c00, f64::INFINITY),
        ];
        for (bits, value) in cases {
            assert_eq!(half(bits).to_bits(), f64::to_bits(value), "{bits:x}");
        }
        assert!(half(0x7e00).is_nan());
    }
}
