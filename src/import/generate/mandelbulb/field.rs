//! The scalar field with the meshed zero set, and two bounds that allow skipping whole blocks.

use super::lanes::{LANES, Lanes};

/// Squared radius beyond which an orbit has escaped.
const BAILOUT_SQUARED: f32 = 64.0;
/// Number of steps after which an orbit counts as inside.
const MAX_STEPS: u32 = 12;
/// Number of steps of the proof that a ball is inside.
const PROOF_STEPS: u32 = 20;
/// Assumed Lipschitz constant of the distance estimate. With it no point is misclassified (see the grid's test, which
/// fails for 0.5).
const LIPSCHITZ: f32 = 1.5;
/// Squared distance from the axis (ρ²) below which the azimuth is ignored.
const ON_AXIS: f32 = 1e-9;

/// The field f(c) = DE(c) − iso, negative inside; the documentation of the parent module has the formulas.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Value of the distance estimate at the surface.
    pub iso: f32,
    /// Limit of the derivative. Beyond it the distance is too small to estimate, and 0 is used.
    derivative_limit: f32,
    /// (cos, sin) of the phase that each step adds to the azimuth.
    phase: [f32; 2],
}

impl Field {
    /// Creates the field for cells of size `h`. The offset `iso` removes detail finer than the cells.
    pub fn new(h: f64, iso_cells: f64, phase: f64) -> Self {
        Self {
            iso: (iso_cells * h) as f32,
            derivative_limit: (1000.0 / h) as f32,
            phase: [phase.cos() as f32, phase.sin() as f32],
        }
    }

    /// Computes one step z → z⁸ (without the + c) with multiplications, one root and one division. With w = z + i·ρ, w⁸
    /// gives r⁸ cos 8θ and r⁸ sin 8θ; (x + i·y)⁸ / ρ⁸ gives cosine and sine of 8φ.
    #[inline(always)]
    fn power8(&self, [x, y, z]: [Lanes; 3]) -> [Lanes; 3] {
        let square = |re: Lanes, im: Lanes| {
            let both = re * im;
            (re * re - im * im, both + both)
        };
        let rho2 = x * x + y * y;
        // w² = (z² − ρ²) + i·ρ·(2z); the factor ρ of the imaginary part is kept apart.
        let (mut re, mut im) = (z * z - rho2, z + z);
        for _ in 0..2 {
            let both = re * im;
            (re, im) = (re * re - rho2 * im * im, both + both);
        }
        let (cx, cy) = square(x, y);
        let (cx, cy) = square(cx, cy);
        let (cx, cy) = square(cx, cy);
        let rho4 = rho2 * rho2;
        // On the axis sin 8θ is 0.
        let off_axis = rho2.above(Lanes::all(ON_AXIS));
        let scale = im * rho2.sqrt() * off_axis.over(off_axis.pick(rho4 * rho4, Lanes::all(1.0)));
        let [pc, ps] = self.phase.map(Lanes::all);
        [scale * (cx * pc - cy * ps), scale * (cx * ps + cy * pc), re]
    }

    /// Returns the field at eight points. Values are at least −iso, and exactly −iso if the orbit does not escape. The
    /// eight orbits advance in lockstep, so that latencies overlap; each result equals that of a single point.
    pub fn values(&self, points: &[[f32; 3]; LANES]) -> [f32; LANES] {
        let c: [Lanes; 3] = std::array::from_fn(|a| Lanes(std::array::from_fn(|l| points[l][a])));
        let mut z = c;
        let mut derivative = Lanes::all(1.0);
        let mut running = Lanes::all(1.0);
        // |z|² of escaped orbits, else 0.
        let mut escaped = Lanes::all(0.0);
        let [one, bailout, limit] = [1.0, BAILOUT_SQUARED, self.derivative_limit].map(Lanes::all);
        for _ in 0..MAX_STEPS {
            let r2 = z[0] * z[0] + z[1] * z[1] + z[2] * z[2];
            let out = running * r2.above(bailout);
            escaped = out.pick(r2, escaped);
            running = running - out;
            running = running - running * derivative.above(limit);
            if running.sum() == 0.0 {
                break;
            }
            let r6 = r2 * r2 * r2;
            derivative = running.pick(Lanes::all(8.0) * r6 * r2.sqrt() * derivative + one, derivative);
            let p = self.power8(z);
            for a in 0..3 {
                z[a] = running.pick(p[a] + c[a], z[a]);
            }
        }
        std::array::from_fn(|l| {
            let r2 = escaped.0[l];
            let distance = if r2 > 0.0 { 0.25 * r2.sqrt() * r2.ln() / derivative.0[l] } else { 0.0 };
            distance - self.iso
        })
    }

    /// Returns the field at one point.
    pub fn value(&self, c: [f32; 3]) -> f32 {
        self.values(&[c; LANES])[0]
    }

    /// True if the ball of `radius` around a point is outside, given the field's value at the point.
    pub fn ball_is_outside(&self, value: f32, radius: f32) -> bool {
        value > LIPSCHITZ * radius
    }

    /// True if no orbit of the ball around `c` can ever escape. Ball arithmetic bounds images of balls by balls until
    /// one maps into itself. `false` proves nothing.
    pub fn ball_is_inside(&self, c: [f32; 3], radius: f32) -> bool {
        let norm = |p: [f32; 3]| (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
        // t⁸ + |c| <= t holds at t = 8^(−1/7) for |c| up to 0.65: the ball around 0 maps into itself.
        if norm(c) + radius <= 0.65 {
            return true;
        }
        let (mut z, mut spread) = (c, radius);
        let mut anchor: Option<([f32; 3], f32)> = None;
        for step in 0..PROOF_STEPS {
            if step == 8 || step == 14 {
                spread = spread * 1.05 + 1e-6;
                anchor = Some((z, spread));
            }
            let reach = norm(z) + spread;
            if reach > 1.3 {
                return false;
            }
            // Arcs of azimuth are stretched by |sin 8θ| / sin θ <= min(8, 1 / sin θ) more than other directions.
            let rho_least = ((z[0] * z[0] + z[1] * z[1]).sqrt() - spread).max(0.0);
            let stretch = (reach / rho_least.max(1e-6)).clamp(1.0, 8.0);
            let p = self.power8(z.map(Lanes::all));
            z = std::array::from_fn(|a| p[a].0[0] + c[a]);
            spread = 8.0 * reach.powi(7) * stretch * spread + radius;
            if let Some((a, room)) = anchor
                && norm([z[0] - a[0], z[1] - a[1], z[2] - a[2]]) + spread <= room
            {
                return true;
            }
        }
        false
    }
}
