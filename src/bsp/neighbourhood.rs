//! Which points of Q are computed together: all, or, of many, a compact block and the points around it.

use super::BspConfig;
use super::chart::{self, Chart};
use super::layout::spherical_layout;
use super::sheets::SheetFinder;
#[cfg(test)]
use crate::geometry::KdTree;
use crate::tensor::Tensor;
use std::sync::Arc;

/// A part of the points Q with everything that the patches of its centres depend on.
///
/// The context is p points, the b centres first, and all indices below are into it. If the part is all of Q, it is Q.
/// Otherwise it also holds the points near the centres; these may miss neighbours of their own that are not in the
/// context.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbourhood {
    context: Vec<u32>,
    centres: usize,
    neighbours: Arc<[u32]>,
    reach: Option<Arc<[u32]>>,
    /// The initial codes of the context, p x 3, unit length, if `layout` is set.
    layout: Option<Arc<Tensor>>,
    /// The charts of the centres (b), if there are any.
    charts: Option<Arc<[Chart]>>,
}

/// Initial codes and charts of all points, from which blocks take theirs.
struct Laid {
    codes: Vec<[f32; 3]>,
    charts: Option<Vec<Chart>>,
}

impl Laid {
    fn of(
        points: &[[f32; 3]],
        normals: Option<&[[f32; 3]]>,
        finder: &SheetFinder<'_>,
        config: &BspConfig,
    ) -> Option<Self> {
        if !config.layout {
            return None;
        }
        let n = points.len();
        let all: Vec<u32> = (0..n as u32).collect();
        let codes = spherical_layout(points, &finder.k_nearest(&all, config.neighbours.clamp(1, n)));
        let charts = config.charts.then(|| {
            let near = finder.k_nearest(&all, (chart::FITTED + 1).min(n));
            chart::charts(points, &codes, normals, &near, config)
        });
        Some(Laid { codes, charts })
    }

    /// The initial codes of the points of a block, and the charts of its centres, which are the first `centres` points.
    fn part(&self, context: &[u32], centres: usize) -> (Option<Arc<Tensor>>, Option<Arc<[Chart]>>) {
        let codes: Vec<[f32; 3]> = context.iter().map(|&i| self.codes[i as usize]).collect();
        let own = |charts: &Vec<Chart>| context[..centres].iter().map(|&i| charts[i as usize]).collect();
        (Some(Arc::new(Tensor::from_points(&codes))), self.charts.as_ref().map(own))
    }
}

impl Neighbourhood {
    /// All of Q, `points` (n x 3), as one block; with unit `normals` (n x 3), neighbours are those on the same sheet
    /// first (see [`BspConfig::normal_weight`]).
    ///
    /// # Panics
    /// If there are no points, or there is not one normal a point.
    #[track_caller]
    pub fn whole(points: &[[f32; 3]], normals: Option<&[[f32; 3]]>, config: &BspConfig) -> Self {
        let n = points.len();
        let finder = SheetFinder::new(points, normals, config.normal_weight);
        let context: Vec<u32> = (0..n as u32).collect();
        let reach = config.reach.filter(|&reach| reach < n);
        let reach = reach.map(|reach| finder.k_nearest(&context, reach).into());
        let neighbours = finder.k_nearest(&context, config.neighbours.clamp(1, n)).into();
        let laid = Laid::of(points, normals, &finder, config);
        let (layout, charts) = laid.map_or((None, None), |laid| laid.part(&context, n));
        Neighbourhood { context, centres: n, neighbours, reach, layout, charts }
    }

    /// All of n points as one block, for maps that look at no neighbours.
    pub(super) fn without_neighbours(n: usize) -> Self {
        let context = (0..n as u32).collect();
        Neighbourhood { context, centres: n, neighbours: [].into(), reach: None, layout: None, charts: None }
    }

    /// The same in blocks of at most `size` centres, which are all that is in their context.
    ///
    /// # Panics
    /// If `size` is 0.
    #[track_caller]
    pub(super) fn bare_blocks(points: &[[f32; 3]], size: usize) -> Vec<Self> {
        assert!(size > 0, "blocks of no centres");
        if points.len() <= size {
            return vec![Self::without_neighbours(points.len())];
        }
        let mut parts = Vec::new();
        split((0..points.len() as u32).collect(), points, size, &mut parts);
        let bare = |context: Vec<u32>| Neighbourhood {
            centres: context.len(),
            context,
            neighbours: [].into(),
            reach: None,
            layout: None,
            charts: None,
        };
        parts.into_iter().map(bare).collect()
    }

    /// All `points` (n x 3) in blocks of at most `size` centres: one if there are no more, else halves of halves along
    /// their longest sides. Every point is a centre of one block.
    ///
    /// # Panics
    /// If there are no points or `size` is 0.
    #[track_caller]
    pub fn blocks(
        points: &[[f32; 3]],
        normals: Option<&[[f32; 3]]>,
        config: &BspConfig,
        size: usize,
    ) -> Vec<Self> {
        assert!(size > 0, "blocks of no centres");
        if points.len() <= size {
            return vec![Self::whole(points, normals, config)];
        }
        let finder = SheetFinder::new(points, normals, config.normal_weight);
        let laid = Laid::of(points, normals, &finder, config);
        let mut parts = Vec::new();
        split((0..points.len() as u32).collect(), points, size, &mut parts);
        let block = |centres| {
            let mut block = Self::block(points, normals, &finder, centres, config);
            if let Some(laid) = &laid {
                (block.layout, block.charts) = laid.part(&block.context, block.centres);
            }
            block
        };
        parts.into_iter().map(block).collect()
    }

    fn block(
        points: &[[f32; 3]],
        normals: Option<&[[f32; 3]]>,
        finder: &SheetFinder<'_>,
        centres: Vec<u32>,
        config: &BspConfig,
    ) -> Self {
        let n = points.len();
        let (reach, k) = (config.reach.map(|reach| reach.min(n)), config.neighbours.clamp(1, n));
        let around = reach.unwrap_or(k).max(k);
        let near = finder.k_nearest(&centres, around);
        // Searched separately: each search picks its k from the 4 k nearest in space, so these need not be a subset of
        // `near`.
        let own = finder.k_nearest(&centres, k);
        let mut row = vec![u32::MAX; n];
        let b = centres.len();
        let mut context = centres;
        for (i, &point) in context.iter().enumerate() {
            row[point as usize] = i as u32;
        }
        for &point in near.iter().chain(&own) {
            if row[point as usize] == u32::MAX {
                row[point as usize] = context.len() as u32;
                context.push(point);
            }
        }
        let pick = |all: &[[f32; 3]]| context.iter().map(|&i| all[i as usize]).collect::<Vec<_>>();
        let (places, normals) = (pick(points), normals.map(pick));
        let others: Vec<u32> = (b as u32..context.len() as u32).collect();
        let within = SheetFinder::new(&places, normals.as_deref(), config.normal_weight);
        let neighbours =
            own.iter().map(|&point| row[point as usize]).chain(within.k_nearest(&others, k)).collect();
        let reach = reach.map(|reach| {
            let nearest = near.chunks_exact(around).flat_map(|near| &near[..reach]);
            nearest.map(|&point| row[point as usize]).collect()
        });
        Neighbourhood { context, centres: b, neighbours, reach, layout: None, charts: None }
    }

    /// Lists every point in the reach of every centre, nearest first.
    #[cfg(test)]
    pub(super) fn attend_to_all(&mut self, points: &[[f32; 3]]) {
        self.reach = Some(KdTree::new(points).k_nearest(points, points.len()).into());
    }

    /// The context's indices among all points (p), the centres first.
    pub fn context(&self) -> &[u32] {
        &self.context
    }

    /// The centres' indices among all points (b).
    pub fn centres(&self) -> &[u32] {
        &self.context[..self.centres]
    }

    /// The neighbours of every context point, p k.
    pub(super) fn neighbours(&self) -> Arc<[u32]> {
        self.neighbours.clone()
    }

    /// Where the codes of the context begin, p x 3, if they have a layout.
    pub(super) fn layout(&self) -> Option<&Arc<Tensor>> {
        self.layout.as_ref()
    }

    /// The charts of the centres, if there are any.
    pub(super) fn charts(&self) -> Option<&Arc<[Chart]>> {
        self.charts.as_ref()
    }

    /// The distance to Q up to which a point of S adds nothing to L_para, one for each point of the block's part of S
    /// (b M), working frame; `None` if there is no such distance.
    pub fn slack(&self, config: &BspConfig, n: usize) -> Option<Arc<[f32]>> {
        let charts = self.charts.as_ref().filter(|_| config.slack > 0.0)?;
        let cap = chart::cap_radius(config.patch, config.codes(n));
        let radii = charts.iter().map(|chart| config.slack * chart.radius(cap));
        Some(radii.flat_map(|radius| std::iter::repeat_n(radius, config.patch)).collect())
    }

    /// The points that the patch of each centre attends to, as many for each; `None` for the whole context.
    pub(super) fn reach(&self) -> Option<&Arc<[u32]>> {
        self.reach.as_ref()
    }
}

fn split(mut points: Vec<u32>, at: &[[f32; 3]], size: usize, parts: &mut Vec<Vec<u32>>) {
    if points.len() <= size {
        parts.push(points);
        return;
    }
    let extent = |d: usize| {
        let values = || points.iter().map(|&i| at[i as usize][d]);
        values().fold(f32::MIN, f32::max) - values().fold(f32::MAX, f32::min)
    };
    let longest = (0..3).fold(0, |best, d| if extent(d) > extent(best) { d } else { best });
    let order =
        |a: &u32, b: &u32| at[*a as usize][longest].total_cmp(&at[*b as usize][longest]).then(a.cmp(b));
    points.sort_unstable_by(order);
    let upper = points.split_off(points.len() / 2);
    split(points, at, size, parts);
    split(upper, at, size, parts);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ops::testing::normal;

    #[test]
    fn blocks_hold_every_point_once_and_what_it_depends_on() {
        let config = BspConfig { reach: Some(6), ..super::super::config::tests::small(Some(6), true) };
        for n in [1, 2, 7, 40, 133] {
            let points = normal(&[n, 3], n as u64).to_points();
            let turned = normal(&[n, 3], 7).to_points();
            for (size, normals) in [3, 16, 200].into_iter().flat_map(|s| [(s, None), (s, Some(&turned[..]))])
            {
                let finder = SheetFinder::new(&points, normals, config.normal_weight);
                let blocks = Neighbourhood::blocks(&points, normals, &config, size);
                let mut all: Vec<u32> = blocks.iter().flat_map(|b| b.centres().to_vec()).collect();
                all.sort_unstable();
                assert!(all.into_iter().eq(0..n as u32));
                for block in &blocks {
                    let b = block.centres().len();
                    assert!(b <= size.max(n.min(size)));
                    let of_all = |rows: &[u32]| -> Vec<u32> {
                        rows.iter().map(|&r| block.context()[r as usize]).collect()
                    };
                    let k = config.neighbours.min(n);
                    // The centres' own neighbours are those among all points.
                    assert_eq!(of_all(&block.neighbours[..b * k]), finder.k_nearest(block.centres(), k));
                    if let Some(reach) = block.reach() {
                        assert_eq!(
                            of_all(reach),
                            finder.k_nearest(block.centres(), config.reach.unwrap().min(n))
                        );
                    }
                }
            }
        }
    }
}
