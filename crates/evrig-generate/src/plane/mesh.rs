//! Where the pixels of a camera are found in a frame.

use evrig_core::geometry::Size;

/// Pixels from node to node.
pub(super) const NODE_SPACING_PX: usize = 8;

/// Places in a frame, one for each pixel: exact at every [`NODE_SPACING_PX`]th pixel each way,
/// straight between.
///
/// What bends the way there, perspective, lens and rolling rows, bends it over the whole image:
/// with a lens that moves its corner by 30 px, straight between nodes is less than 0.02 px off.
pub(super) struct PixelMesh {
    n_columns: usize,
    nodes: Vec<[f32; 2]>,
}

/// The places of the pixels of one row from a node up to the next.
#[derive(Clone, Copy)]
pub(super) struct MeshRow {
    start: [f32; 2],
    step: [f32; 2],
}

impl PixelMesh {
    /// Middles of the pixels that are nodes of a grid, row by row; the last may lie beyond its
    /// edge.
    pub(super) fn pixels(size: Size) -> impl Iterator<Item = [f64; 2]> {
        let [columns, rows] = [size.width, size.height].map(n_nodes);
        let at = |node: usize| (node * NODE_SPACING_PX) as f64 + 0.5;
        (0..rows).flat_map(move |y| (0..columns).map(move |x| [at(x), at(y)]))
    }

    /// The mesh of a grid, from the places of its nodes.
    pub(super) fn new(size: Size, places: impl Iterator<Item = [f64; 2]>) -> Self {
        let nodes = places.map(|place| place.map(|part| part as f32)).collect();
        Self { n_columns: n_nodes(size.width), nodes }
    }

    /// The places of row `y` from the node number `cell` on.
    pub(super) fn line(&self, cell: usize, y: usize) -> MeshRow {
        let above = y / NODE_SPACING_PX * self.n_columns + cell;
        let share = (y % NODE_SPACING_PX) as f32 / NODE_SPACING_PX as f32;
        let at = |node: usize| {
            let [a, b] = [self.nodes[node], self.nodes[node + self.n_columns]];
            [0, 1].map(|i| a[i] + (b[i] - a[i]) * share)
        };
        let [start, end] = [at(above), at(above + 1)];
        MeshRow { start, step: [0, 1].map(|i| (end[i] - start[i]) / NODE_SPACING_PX as f32) }
    }
}

impl MeshRow {
    /// The place of the pixel `k` behind the node.
    #[inline]
    pub(super) fn at(&self, k: usize) -> [f32; 2] {
        [0, 1].map(|i| self.start[i] + self.step[i] * k as f32)
    }
}

/// Nodes along a side: one before each pixel or at it, and one behind.
fn n_nodes(side: u16) -> usize {
    usize::from(side).div_ceil(NODE_SPACING_PX) + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::pixel_centre;

    #[test]
    fn straight_between_nodes_is_near_the_bent_way_everywhere() {
        let size = Size::new(691, 517);
        // A barrel, as strong as a wide lens of 600 px has it.
        let bend = |[u, v]: [f64; 2]| {
            let [x, y] = [(u - 340.0) / 600.0, (v - 262.0) / 600.0];
            let r2 = x * x + y * y;
            let by = 600.0 * (1.0 - 0.2 * r2 + 0.05 * r2 * r2);
            [340.0 + by * x, 262.0 + by * y]
        };
        // A plane that is seen askew, through a lens, row after row while it moves.
        let place = |[u, v]: [f64; 2]| {
            let z = 1.0 + 1e-4 * u - 5e-5 * v;
            bend([(u + 0.03 * v + 2.0 - 0.005 * v) / z, (v - 0.02 * u + 1.0) / z])
        };
        let mesh = PixelMesh::new(size, PixelMesh::pixels(size).map(place));
        let (mut worst, mut moved) = (0.0_f64, 0.0_f64);
        for i in 0..size.n_pixels() {
            let (x, y) = (i % 691, i / 691);
            let found = mesh.line(x / NODE_SPACING_PX, y).at(x % NODE_SPACING_PX).map(f64::from);
            let truth = place(pixel_centre(size, i));
            worst = worst.max((found[0] - truth[0]).hypot(found[1] - truth[1]));
            let straight = pixel_centre(size, i);
            let bent = bend(straight);
            moved = moved.max((bent[0] - straight[0]).hypot(bent[1] - straight[1]));
        }
        assert!(worst < 0.02 && moved > 30.0, "{worst} {moved}");
    }
}
