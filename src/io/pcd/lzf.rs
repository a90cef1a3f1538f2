//! LZF, the packing of binary PCD files: literal bytes, and repeats of what came before.

/// Unpacks to exactly `size` bytes; None where the bytes do not lead there.
pub(super) fn unpack(packed: &[u8], size: usize) -> Option<Vec<u8>> {
    // A packed byte gives at most 264 / 3 bytes, which bounds what a false size can reserve.
    if size / 88 > packed.len() {
        return None;
    }
    let mut out = Vec::with_capacity(size);
    let mut at = 0;
    let mut next = || {
        let byte = packed.get(at).copied();
        at += 1;
        byte
    };
    while out.len() < size {
        let control = usize::from(next()?);
        if control < 32 {
            for _ in 0..=control {
                out.push(next()?);
            }
        } else {
            let mut length = control >> 5;
            if length == 7 {
                length += usize::from(next()?);
            }
            let back = ((control & 31) << 8) + usize::from(next()?) + 1;
            let from = out.len().checked_sub(back)?;
            for i in 0..length + 2 {
                out.push(out[from + i]);
            }
        }
        if out.len() > size {
            return None;
        }
    }
    Some(out)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A slow packer: the longest repeat within the last 8192 bytes, else a literal.
    pub fn pack(bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut literal: Vec<u8> = Vec::new();
        let flush = |literal: &mut Vec<u8>, out: &mut Vec<u8>| {
            for run in literal.chunks(32) {
                out.push(run.len() as u8 - 1);
                out.extend(run);
            }
            literal.clear();
        };
        let mut at = 0;
        while at < bytes.len() {
            let best = (at.saturating_sub(8192)..at)
                .map(|from| {
                    let same = |i: &usize| bytes[from + i] == bytes[at + i];
                    ((0..(bytes.len() - at).min(264)).take_while(same).count(), at - from - 1)
                })
                .max()
                .filter(|(length, _)| *length >= 3);
            let Some((length, back)) = best else {
                literal.push(bytes[at]);
                at += 1;
                continue;
            };
            flush(&mut literal, &mut out);
            let code = length - 2;
            out.push(((code.min(7) << 5) + (back >> 8)) as u8);
            if code >= 7 {
                out.push((code - 7) as u8);
            }
            out.push(back as u8);
            at += length;
        }
        flush(&mut literal, &mut out);
        out
    }

    proptest! {
        #[test]
        fn what_was_packed_comes_back(
            bytes in prop::collection::vec(0..4_u8, 0..600), random in prop::collection::vec(any::<u8>(), 0..60),
        ) {
            let packed = pack(&bytes);
            prop_assert_eq!(unpack(&packed, bytes.len()), Some(bytes.clone()));
            if !bytes.is_empty() {
                prop_assert_eq!(unpack(&packed[..packed.len() - 1], bytes.len()), None);
            }
            // Anything is answered, and nothing is longer than asked for.
            let any = unpack(&random, 500);
            prop_assert!(any.is_none_or(|o| o.len() == 500));
        }
    }

    #[test]
    fn a_false_size_reserves_nothing() {
        assert_eq!(unpack(&[0, 1], usize::MAX), None);
        assert_eq!(unpack(&pack(&[7; 5000]), 5000).unwrap(), [7; 5000]);
    }
}
