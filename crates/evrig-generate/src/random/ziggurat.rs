//! Normal draws by the ziggurat of Marsaglia and Tsang (J. Stat. Softw. 5(8), 2000)
//! with 256 layers; layer and position come from separate bits, as Doornik (2005) asks.

use std::sync::LazyLock;

/// A source of random words.
pub(super) trait RandomWords {
    /// 64 random bits.
    fn bits(&mut self) -> u64;

    /// Uniform in the open interval (0, 1).
    fn uniform(&mut self) -> f64;
}

const N_LAYERS: usize = 256;
/// Where the tail begins, for 256 layers.
const EDGE: f64 = 3.654_152_885_361_009;
/// Area of each layer under exp(-x²/2), the tail included in the lowest.
const AREA: f64 = 0.004_928_673_233_992_336;

/// Corners of the layers.
#[derive(Debug)]
pub(super) struct Ziggurat {
    /// Width of each layer, from the lowest; the last is 0.
    x: [f64; N_LAYERS + 1],
    /// exp(-x²/2) at each width.
    f: [f64; N_LAYERS + 1],
}

static TABLES: LazyLock<Ziggurat> = LazyLock::new(Ziggurat::new);

fn bell(x: f64) -> f64 {
    (-0.5 * x * x).exp()
}

impl Ziggurat {
    pub(super) fn tables() -> &'static Self {
        &TABLES
    }

    fn new() -> Self {
        let mut x = [0.0; N_LAYERS + 1];
        // The lowest layer is as wide as a rectangle that holds its area, tail included.
        x[0] = AREA / bell(EDGE);
        x[1] = EDGE;
        for i in 2..N_LAYERS {
            x[i] = (-2.0 * (AREA / x[i - 1] + bell(x[i - 1])).ln()).sqrt();
        }
        let f = x.map(bell);
        Self { x, f }
    }

    #[inline]
    pub(super) fn normal(&self, draws: &mut impl RandomWords) -> f64 {
        let (layer, position) = place(draws);
        let x = position * self.x[layer];
        if x.abs() < self.x[layer + 1] { x } else { self.at_the_rim(layer, position, draws) }
    }

    /// What is left of a draw that did not fall inside its layer (1.2 % of them).
    #[cold]
    #[inline(never)]
    fn at_the_rim(&self, mut layer: usize, mut position: f64, draws: &mut impl RandomWords) -> f64 {
        loop {
            let x = position * self.x[layer];
            if x.abs() < self.x[layer + 1] {
                return x;
            }
            if layer == 0 {
                return tail(draws).copysign(position);
            }
            let height = self.f[layer] + (self.f[layer + 1] - self.f[layer]) * draws.uniform();
            if height < bell(x) {
                return x;
            }
            (layer, position) = place(draws);
        }
    }
}

/// A layer, and a place along it in [-1, 1).
#[inline]
fn place(draws: &mut impl RandomWords) -> (usize, f64) {
    let bits = draws.bits();
    let layer = (bits & (N_LAYERS as u64 - 1)) as usize;
    // 53 signed bits above the layer's.
    (layer, ((bits as i64) >> 11) as f64 * (1.0 / (1_u64 << 52) as f64))
}

/// A normal draw beyond [`EDGE`] (Marsaglia 1964).
fn tail(draws: &mut impl RandomWords) -> f64 {
    loop {
        let beyond = -draws.uniform().ln() / EDGE;
        if -2.0 * draws.uniform().ln() > beyond * beyond {
            return EDGE + beyond;
        }
    }
}
