//! Weights that pass smoothly from one rule to another.

/// The stretch over which a weight changes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ramp {
    pub from: f32,
    pub to: f32,
}

impl Ramp {
    /// 0 up to `from`, 1 from `to` on, smooth between them.
    pub fn rising(self, x: f32) -> f32 {
        let t = ((x - self.from) / (self.to - self.from)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// 1 up to `from`, 0 from `to` on, smooth between them.
    pub fn falling(self, x: f32) -> f32 {
        1.0 - self.rising(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_from_one_end_to_the_other() {
        let ramp = Ramp { from: 0.5, to: 1.5 };
        assert_eq!([-1.0, 0.5, 1.0, 1.5, 9.0].map(|x| ramp.rising(x)), [0.0, 0.0, 0.5, 1.0, 1.0]);
        assert_eq!([0.5, 1.0, 1.5].map(|x| ramp.falling(x)), [1.0, 0.5, 0.0]);
    }
}
