//! Text tables.

/// Lines with their cells in columns, two spaces apart. A line shorter than the first may end in a
/// remark, which widens no column.
pub(super) fn aligned(lines: &[Vec<String>]) -> String {
    let n_columns = lines.first().map_or(0, Vec::len);
    let width = |column: usize| {
        let in_column =
            lines.iter().filter(|line| line.len() >= n_columns || column + 1 < line.len());
        in_column.filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max()
    };
    let widths: Vec<usize> = (0..n_columns).map(|column| width(column).unwrap_or(0)).collect();
    let line = |cells: &Vec<String>| {
        let width = |column: usize| widths.get(column).copied().unwrap_or(0);
        let padded = cells.iter().enumerate().map(|(i, cell)| format!("{cell:<0$}", width(i)));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    lines.iter().map(line).collect::<Vec<_>>().join("\n")
}
