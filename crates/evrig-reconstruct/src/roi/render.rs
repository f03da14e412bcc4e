//! Frames of a tag with known truth, for tests and the table of the tracker's errors.

/// Random numbers: SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
pub(super) struct TestRandom(pub(super) u64);

impl TestRandom {
    /// Even in 0..1.
    pub(super) fn even(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Even between two numbers.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.even()
    }

    /// Standard normal, by Box and Muller.
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.even()).ln()).sqrt();
        radius * (2.0 * std::f64::consts::PI * self.even()).cos()
    }
}

/// A tag's cells: `true` is black, row by row from the top, the black border included.
pub(super) struct TagCells {
    /// Cells along a side.
    pub(super) side: usize,
    /// All of them.
    pub(super) black: Vec<bool>,
}

impl TagCells {
    /// A tag from its code word. Its bits run clockwise along each ring of cells, from outside in:
    /// each quarter of the word covers one side, given here for the upper side.
    fn of(code: u64, side: usize, upper: &[(usize, usize)], centre: bool) -> Self {
        let n_bits = (side - 2) * (side - 2);
        let mut black = vec![true; side * side];
        let mut places: Vec<(usize, usize)> = Vec::new();
        for turn in 0..4 {
            let rotated =
                upper.iter().map(|&(x, y)| (0..turn).fold((x, y), |(x, y), _| (side - 1 - y, x)));
            places.extend(rotated);
        }
        if centre {
            places.push((side / 2, side / 2));
        }
        assert_eq!(places.len(), n_bits, "each bit has its cell");
        for (bit, (x, y)) in places.into_iter().enumerate() {
            black[y * side + x] = code >> (n_bits - 1 - bit) & 1 == 0;
        }
        Self { side, black }
    }

    /// Tags 0 and 1 of tag36h11.
    pub(super) fn tag36h11(id: usize) -> Self {
        let upper = [(1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (2, 2), (3, 2), (4, 2), (3, 3)];
        Self::of([0xd_7e00_984b, 0xd_da66_4ca7][id], 8, &upper, false)
    }

    /// Tag 0 of tag25h9.
    pub(super) fn tag25h9() -> Self {
        let upper = [(1, 1), (2, 1), (3, 1), (4, 1), (2, 2), (3, 2)];
        Self::of(0x156_f1f4, 7, &upper, true)
    }

    /// Reflectance at a place of the tag, its side being 0..1 to the right and down: 0 black, 1
    /// white.
    fn at(&self, x: f64, y: f64) -> f64 {
        if !(0.0..1.0).contains(&x) || !(0.0..1.0).contains(&y) {
            return 1.0;
        }
        let n = self.side as f64;
        let cell = (y * n) as usize * self.side + (x * n) as usize;
        if self.black[cell] { 0.0 } else { 1.0 }
    }
}

/// How a frame is taken.
#[derive(Clone, Copy)]
pub(super) struct Taking {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Standard deviation of the blur, pixels.
    pub(super) blur_px: f64,
    /// Values of black ink and white paper.
    pub(super) levels: [f64; 2],
}

/// Samples along a pixel's side.
const FINE: usize = 4;

impl Taking {
    /// An APS frame.
    pub(super) fn davis346(blur_px: f64) -> Self {
        Self { width: 346, height: 260, blur_px, levels: [40.0, 210.0] }
    }

    /// The frame without noise. `tag_from_pixel` takes a pixel coordinate to the tag (its side
    /// 0..1, right and down); `corners` say where in the frame it is worth looking. The rest is
    /// paper.
    pub(super) fn render(
        &self,
        cells: &TagCells,
        corners: &[[f64; 2]; 4],
        tag_from_pixel: impl Fn([f64; 2]) -> [f64; 2],
    ) -> Vec<f64> {
        let [black, white] = self.levels;
        let mut frame = vec![white; self.width * self.height];
        let pad = 3.0 + 4.0 * self.blur_px;
        let span = |axis: usize, limit: usize| {
            let parts = corners.iter().map(|corner| corner[axis]);
            let low = parts.clone().fold(f64::INFINITY, f64::min) - pad;
            let high = parts.fold(f64::NEG_INFINITY, f64::max) + pad;
            (low.clamp(0.0, limit as f64) as usize, high.clamp(0.0, limit as f64) as usize)
        };
        let ((x0, x1), (y0, y1)) = (span(0, self.width), span(1, self.height));
        if x1 <= x0 || y1 <= y0 {
            return frame;
        }
        // Beyond the frame's edge the print goes on, so the fine grid does, too. Each sample lies
        // somewhere in its cell: on a regular grid an edge along the rows would be off by up to
        // half a cell all along.
        let reach = (4.0 * self.blur_px * FINE as f64).ceil() as usize;
        let (n_x, n_y) = ((x1 - x0) * FINE + 2 * reach, (y1 - y0) * FINE + 2 * reach);
        let mut dice = TestRandom(17);
        let mut place = |i: usize, from: usize| {
            from as f64 + (i as f64 + dice.even() - reach as f64) / FINE as f64
        };
        let mut fine = vec![0.0; n_x * n_y];
        for j in 0..n_y {
            for i in 0..n_x {
                let [x, y] = tag_from_pixel([place(i, x0), place(j, y0)]);
                fine[j * n_x + i] = cells.at(x, y);
            }
        }
        let kernel: Vec<f64> = (0..=2 * reach)
            .map(|k| {
                let distance = (k as f64 - reach as f64) / FINE as f64 / self.blur_px;
                (-0.5 * distance * distance).exp()
            })
            .collect();
        // Rows first, then columns, each gathered into pixels at once.
        let width = x1 - x0;
        let rows = gather(&kernel, n_y, width, |j, i| fine[j * n_x + i]);
        let columns = gather(&kernel, width, y1 - y0, |x, j| rows[j * width + x]);
        for y in y0..y1 {
            for x in x0..x1 {
                let share = columns[(x - x0) * (y1 - y0) + y - y0];
                frame[y * self.width + x] = black + (white - black) * share;
            }
        }
        frame
    }
}

/// Blurs each of `n_lines` lines of fine samples and gathers it into `n_pixels` pixels.
fn gather(
    kernel: &[f64],
    n_lines: usize,
    n_pixels: usize,
    sample: impl Fn(usize, usize) -> f64,
) -> Vec<f64> {
    let total = kernel.iter().sum::<f64>() * FINE as f64;
    let mut gathered = Vec::with_capacity(n_lines * n_pixels);
    for line in 0..n_lines {
        for pixel in 0..n_pixels {
            let part = |from: usize| -> f64 {
                kernel.iter().enumerate().map(|(k, w)| w * sample(line, from + k)).sum()
            };
            gathered.push((0..FINE).map(|f| part(pixel * FINE + f)).sum::<f64>() / total);
        }
    }
    gathered
}

/// Samples of 8 bits with noise.
pub(super) fn to_8_bits(frame: &[f64], noise: f64, dice: &mut TestRandom) -> Vec<u8> {
    frame.iter().map(|v| (v + noise * dice.normal()).round().clamp(0.0, 255.0) as u8).collect()
}

/// A tag of the given side somewhere in the frame, turned at will, tilted mildly: its corners
/// (bottom left, bottom right, top right, top left). The tilt moves each corner by up to 8 % of
/// the side.
pub(super) fn random_corners(side: f64, taking: &Taking, dice: &mut TestRandom) -> [[f64; 2]; 4] {
    let turn = dice.between(0.0, 2.0 * std::f64::consts::PI);
    let (sin, cos) = turn.sin_cos();
    let reach = 0.72 * side * 1.1 + 10.0;
    let centre = [
        dice.between(reach, taking.width as f64 - reach),
        dice.between(reach, taking.height as f64 - reach),
    ];
    [[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]].map(|[x, y]: [f64; 2]| {
        let x = side * (x + dice.between(-0.08, 0.08));
        let y = side * (y + dice.between(-0.08, 0.08));
        [centre[0] + cos * x - sin * y, centre[1] + sin * x + cos * y]
    })
}
