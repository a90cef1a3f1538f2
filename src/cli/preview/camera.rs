//! Where a point of the scene is in the picture.

use super::{Axis, View};

/// Distance of the camera from the middle of the scene, in longest sides: near enough for some perspective.
const DISTANCE: f64 = 3.2;
/// Part of the picture that stays free on each side.
const MARGIN: f64 = 0.07;

/// A perspective camera that looks at the origin.
pub struct Camera {
    /// Right, up and back of the camera, in the scene's coordinates.
    axes: [[f64; 3]; 3],
    /// Samples per unit of `x / depth`.
    zoom: f64,
    /// Where `x / depth` and `y / depth` are 0, in samples.
    centre: [f64; 2],
    /// Least and greatest depth of the scene.
    depths: [f32; 2],
    size: usize,
}

impl Camera {
    /// The camera that gets all of `scene` (n x 3, around the origin, about 1 long) on a square of `size` samples.
    pub fn around(scene: &[[f32; 3]], view: &View, size: usize) -> Self {
        let (around, above) =
            (view.angles.around.to_radians(), view.angles.above.clamp(-89.0, 89.0).to_radians());
        // The two level axes follow the upward one in cyclic order, so that no view is mirrored.
        let up_axis = match view.up {
            Axis::X => 0,
            Axis::Y => 1,
            Axis::Z => 2,
        };
        let place = |level: f64, side: f64, up: f64| {
            let mut v = [0.0; 3];
            v[(up_axis + 1) % 3] = level;
            v[(up_axis + 2) % 3] = side;
            v[up_axis] = up;
            v
        };
        let back = place(above.cos() * around.cos(), above.cos() * around.sin(), above.sin());
        let right = place(-around.sin(), around.cos(), 0.0);
        let up = cross(back, right);
        let mut camera =
            Camera { axes: [right, up, back], zoom: 1.0, centre: [0.0; 2], depths: [0.0, 1.0], size };

        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &p in scene {
            let [x, y, depth] = camera.view(p).map(f64::from);
            for (a, at) in [x / depth, y / depth, depth].into_iter().enumerate() {
                low[a] = low[a].min(at);
                high[a] = high[a].max(at);
            }
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]).max(1e-6);
        camera.zoom = size as f64 * (1.0 - 2.0 * MARGIN) / extent;
        let half = 0.5 * size as f64;
        camera.centre =
            [half - camera.zoom * 0.5 * (low[0] + high[0]), half + camera.zoom * 0.5 * (low[1] + high[1])];
        camera.depths = [low[2] as f32, high[2] as f32];
        camera
    }

    /// How far back in the scene a depth is, from 0 to 1.
    pub fn backness(&self, depth: f32) -> f32 {
        let [near, far] = self.depths;
        ((depth - near) / (far - near).max(1e-6)).clamp(0.0, 1.0)
    }

    /// A point in the camera's coordinates: right, up, and depth in front of it.
    pub fn view(&self, p: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.rotate(p.map(f64::from));
        [x as f32, y as f32, (DISTANCE - z) as f32]
    }

    /// A direction in the camera's coordinates: right, up, towards the camera.
    pub fn direction(&self, n: [f32; 3]) -> [f32; 3] {
        self.rotate(n.map(f64::from)).map(|x| x as f32)
    }

    /// Where a point in the camera's coordinates is in the picture, in samples from the top left.
    pub fn screen(&self, v: [f32; 3]) -> [f32; 2] {
        let [x, y, depth] = v.map(f64::from);
        [(self.centre[0] + self.zoom * x / depth) as f32, (self.centre[1] - self.zoom * y / depth) as f32]
    }

    /// The point in the camera's coordinates that is seen at a place of the picture in a depth.
    pub fn unscreen(&self, x: f32, y: f32, depth: f32) -> [f32; 3] {
        let scale = depth / self.zoom as f32;
        [(x - self.centre[0] as f32) * scale, (self.centre[1] as f32 - y) * scale, depth]
    }

    /// Samples per unit of length at a depth.
    pub fn scale_at(&self, depth: f32) -> f32 {
        self.zoom as f32 / depth
    }

    /// Width and height of the picture, in samples.
    pub fn size(&self) -> usize {
        self.size
    }

    fn rotate(&self, p: [f64; 3]) -> [f64; 3] {
        self.axes.map(|a| a[0] * p[0] + a[1] * p[1] + a[2] * p[2])
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::super::Angles;
    use super::*;

    #[test]
    fn up_is_up_and_nothing_is_mirrored() {
        for (axis, up) in [(Axis::X, 0), (Axis::Y, 1), (Axis::Z, 2)] {
            for (around, above) in [(0.0, 0.0), (35.0, 28.0), (200.0, -60.0)] {
                let view = View { angles: Angles { around, above }, up: axis };
                let corners = [[-0.5f32; 3], [0.5; 3]];
                let camera = Camera::around(&corners, &view, 100);
                let mut top = [0.0; 3];
                top[up] = 0.4;
                let at = |p| camera.screen(camera.view(p));
                assert!(at(top)[1] < at([0.0; 3])[1], "up on the screen means a smaller row");
                let [r, u, b] = camera.axes;
                let determinant = cross(r, u).iter().zip(&b).map(|(x, y)| x * y).sum::<f64>();
                assert!((determinant - 1.0).abs() < 1e-12);
                let v = camera.view([0.1, 0.2, -0.3]);
                let [x, y] = camera.screen(v);
                let back = camera.unscreen(x, y, v[2]);
                assert!(v.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-4));
                for corner in corners {
                    assert!(at(corner).iter().all(|x| (6.0..94.0).contains(x)), "{:?}", at(corner));
                }
            }
        }
    }
}
