//! Cubic convolution on an image.

use super::bilinear;
use super::frame_view::FrameView;

/// Weights of four neighbours at a distance from the second (Keys, IEEE Trans. ASSP 29, 1981,
/// a = -1/2): exact for a parabola, so that thin lines keep the contrast that bilinear
/// interpolation takes from them.
fn weights(u: f32) -> [f32; 4] {
    [
        u * (-0.5 + u * (1.0 - 0.5 * u)),
        1.0 + u * u * (-2.5 + 1.5 * u),
        u * (0.5 + u * (2.0 - 1.5 * u)),
        0.5 * u * u * (u - 1.0),
    ]
}

/// The four pixels around a position among `n`, and their weights; clamped beyond the border.
fn neighbours(at: f32, n: usize) -> ([usize; 4], [f32; 4]) {
    let ([first, second], u) = bilinear::neighbours(at, n);
    ([first.saturating_sub(1), first, second, (first + 2).min(n - 1)], weights(u))
}

/// The value at a position in pixels from the middle of the first pixel; the nearest pixel's where an
/// undershoot leaves no light.
pub(super) fn cubic(view: FrameView<'_>, [x, y]: [f32; 2]) -> f32 {
    let (columns, across) = neighbours(x, view.width());
    let (rows, down) = neighbours(y, view.height());
    let along = |row: usize| -> f32 {
        let line = &view.values[row * view.width()..][..view.width()];
        columns.iter().zip(across).map(|(column, weight)| line[*column] * weight).sum()
    };
    let value: f32 = rows.iter().zip(down).map(|(row, weight)| along(*row) * weight).sum();
    if value > 0.0 { value } else { view.at([x.round(), y.round()]) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Size;

    #[test]
    fn a_parabola_is_read_back_and_no_light_is_left_at_an_edge() {
        let size = Size { width: 8, height: 7 };
        let curved = |x: f32, y: f32| 20.0 + 0.5 * x * x - 0.25 * y * y + 0.1 * x * y;
        let values: Vec<f32> = (0..56).map(|i| curved((i % 8) as f32, (i / 8) as f32)).collect();
        let view = FrameView { size, values: &values };
        for [x, y] in [[2.0, 3.0], [3.25, 2.5], [5.75, 4.125]] {
            assert!((cubic(view, [x, y]) - curved(x, y)).abs() < 1e-4);
        }
        let edge: Vec<f32> = (0..56).map(|i| if i % 8 < 4 { 0.001 } else { 1.0 }).collect();
        let view = FrameView { size, values: &edge };
        assert!((0..80).all(|i| cubic(view, [0.1 * i as f32, 3.0]) > 0.0));
    }
}
