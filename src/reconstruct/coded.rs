//! Denoised points, S and grid vertices with their codes: what the paper's figures are drawn from.

use super::Phase;
use super::band::ActiveBand;
use super::phases::MAX_COORDINATE;
use super::phases::train::TrainStep;
use super::setup::Setup;
use super::state::State;
use crate::bsp::ParameterizedSurface;
use crate::error::Error;
use crate::geometry::nearest_points;

/// Points of space with codes on the unit sphere, to be drawn in the colours of the codes
/// ([`code_colour`](crate::bsp::code_colour)). Places are in the frame and unit of the input.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Coded {
    /// The denoised points Q, n x 3.
    pub points: Vec<[f64; 3]>,
    /// U(Q), their codes, n x 3.
    pub codes: Vec<[f32; 3]>,
    /// S, i x 3.
    pub surface: Vec<[f64; 3]>,
    /// P, the codes of the patches, which S is made of, i x 3.
    pub patches: Vec<[f32; 3]>,
    /// V, the vertices of the training's grid around the surface, v x 3: the corners of all tetrahedra that it crosses.
    pub verts: Vec<[f64; 3]>,
    /// V', the same vertices moved along the field ([`Deformation`](crate::gdo::Deformation)), v x 3.
    pub moved: Vec<[f64; 3]>,
    /// The code of the point of S nearest to each vertex of V', v x 3.
    pub vert_codes: Vec<[f32; 3]>,
}

/// S and its codes by the parameters of a state, all in the working frame; `None` without a parameterization. If S is
/// not finite, it is as last computed, without codes.
pub(super) fn parameterized(setup: &Setup, state: &State) -> Option<ParameterizedSurface> {
    let map = state.map.as_ref()?;
    // All blocks by the same parameters; where there are several, those in the state are of different steps.
    let all = map.parameterize(&setup.denoised, &setup.blocks);
    // Written so that NaN is refused.
    let near = |points: &[[f32; 3]]| points.as_flattened().iter().all(|x| x.abs() < MAX_COORDINATE);
    if near(&all.surface) && all.codes.as_ref().is_none_or(|codes| near(&codes.points)) {
        return Some(all);
    }
    Some(ParameterizedSurface { surface: state.surface.clone(), codes: None, ..all })
}

/// Denoised points, S and the vertices of the grid with their codes, by the parameters of a state; `None` without
/// codes.
pub(super) fn coded(setup: &Setup, state: &State) -> Result<Option<Coded>, Error> {
    let Some(ParameterizedSurface { points, surface, codes: Some(codes) }) = parameterized(setup, state)
    else {
        return Ok(None);
    };
    let step = match setup.config.phase_at(state.step) {
        (Phase::Train, step) => step,
        _ => 0,
    };
    let (denoised, rings) = (&setup.denoised, setup.config.band.rings);
    let band = ActiveBand::find(&state.field, denoised, setup.resolution_at(step), rings, &|| false)?;
    let [verts, moved] = TrainStep::new(setup, state, &band, step).moved_verts()?;
    let (nearest, _) = nearest_points(&moved, &surface);
    let place = |points: &[[f32; 3]]| setup.frame.place(points);
    Ok(Some(Coded {
        vert_codes: nearest.iter().map(|&i| codes.patches[i as usize]).collect(),
        points: place(&points),
        codes: codes.points,
        surface: place(&surface),
        patches: codes.patches,
        verts: place(&verts),
        moved: place(&moved),
    }))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{at_training, ball, bits, run, tiny};
    use crate::bsp::Parameterization;
    use crate::gdo::Deformation;
    use crate::reconstruct::{Config, Trainer};

    fn distance(p: &[f64; 3]) -> f64 {
        let d = [p[0] - 10.0, p[1] + 4.0, p[2]];
        d.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    #[test]
    fn everything_has_its_code_and_vertices_move_to_the_surface() {
        let mut trainer = Trainer::new(&ball(60), &tiny()).unwrap();
        while !trainer.is_done() {
            trainer.step().unwrap();
        }
        let coded = trainer.coded().unwrap().unwrap();
        assert_eq!((coded.points.len(), coded.codes.len()), (60, 60));
        assert_eq!((coded.surface.len(), coded.patches.len()), (240, 240));
        let v = coded.verts.len();
        assert!(v > 100 && coded.moved.len() == v && coded.vert_codes.len() == v);
        for code in coded.codes.iter().chain(&coded.patches).chain(&coded.vert_codes) {
            assert!((code.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5, "{code:?}");
        }
        // In the input's frame, in which the ball has a radius of 3; a field of so few steps knows it roughly.
        let off = |points: &[[f64; 3]]| {
            points.iter().map(|p| (distance(p) - 3.0).abs()).sum::<f64>() / points.len() as f64
        };
        assert!(off(&coded.points) < 1e-5 && off(&coded.surface) < 1.0, "{}", off(&coded.surface));
        assert!(off(&coded.moved) < 0.85 * off(&coded.verts), "{} {}", off(&coded.moved), off(&coded.verts));
        // The result has this S, and figures of it.
        let result = trainer.finish();
        assert_eq!(result.surface_points(), coded.surface);
        let coverage = result.coverage().unwrap();
        assert_eq!((coverage.points, coverage.surface), (60, 240));
        assert!(coverage.codes.is_some_and(|c| c.sphere == 240 && c.used > 0), "{coverage:?}");
        assert!(coverage.q_to_s > 0.0 && coverage.q_to_s < 0.2, "{coverage:?}");
    }

    #[test]
    fn nothing_of_it_changes_the_run() {
        let config = Config { deformation: Deformation::Offset, ..tiny() };
        let mut trainer = Trainer::new(&ball(50), &config).unwrap();
        while !trainer.is_done() {
            if trainer.steps_done().is_multiple_of(4) {
                trainer.coded().unwrap().unwrap();
            }
            trainer.step().unwrap();
        }
        assert!(bits(&trainer.finish()) == bits(&run(&ball(50), &config)));
    }

    #[test]
    fn maps_without_codes_have_a_surface_to_measure() {
        for (parameterization, measured) in [
            (Parameterization::None, false),
            (Parameterization::Upsample, true),
            (Parameterization::Single, true),
        ] {
            let result = at_training(&ball(50), &Config { parameterization, ..tiny() });
            assert_eq!(result.coded().unwrap(), None);
            let coverage = result.finish().coverage().copied();
            assert_eq!(coverage.is_some(), measured);
            assert!(coverage.is_none_or(|c| c.codes.is_none() && c.surface == 200));
        }
    }

    #[test]
    fn a_surface_that_is_not_finite_leaves_the_last_one_without_codes() {
        let mut trainer = at_training(&ball(50), &tiny());
        let map = trainer.state.map.as_mut().unwrap();
        let last = map.params_mut().values_mut().last_mut().unwrap();
        std::sync::Arc::make_mut(last).data_mut().fill(f32::NAN);
        assert_eq!(trainer.coded().unwrap(), None);
        let kept = trainer.state.surface.clone();
        let result = trainer.finish();
        assert_eq!(result.surface, kept);
        assert!(result.coverage().unwrap().codes.is_none());
    }
}
