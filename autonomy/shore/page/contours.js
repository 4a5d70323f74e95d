// Lines of equal value through a raster (marching squares, Lorensen & Cline's idea in two dimensions).

// Which edges (0 top, 1 right, 2 bottom, 3 left) a line joins, by which corners are above the level:
// bit 0 top left, 1 top right, 2 bottom right, 3 bottom left. Saddles are cut the same way everywhere.
const JOINS = [
  [], [[3, 0]], [[0, 1]], [[3, 1]], [[1, 2]], [[3, 0], [1, 2]], [[0, 2]], [[3, 2]],
  [[2, 3]], [[2, 0]], [[0, 1], [2, 3]], [[2, 1]], [[1, 3]], [[1, 0]], [[0, 3]], [],
];

/** Calls `segment(x1, y1, x2, y2)` in cells (centres at whole numbers) for each piece of the line at `level`. */
export function contour(values, rows, columns, level, segment) {
  for (let row = 0; row + 1 < rows; row += 1) {
    for (let column = 0; column + 1 < columns; column += 1) {
      const start = row * columns + column;
      const a = values[start] - level;
      const b = values[start + 1] - level;
      const c = values[start + columns + 1] - level;
      const d = values[start + columns] - level;
      const joins = JOINS[(a > 0 ? 1 : 0) | (b > 0 ? 2 : 0) | (c > 0 ? 4 : 0) | (d > 0 ? 8 : 0)];
      // A NaN compares as below: only cells with four numbers may carry a line.
      if (!joins.length || a + b + c + d !== a + b + c + d) continue;
      const on = (edge) => {
        if (edge === 0) return [column + a / (a - b), row];
        if (edge === 1) return [column + 1, row + b / (b - c)];
        if (edge === 2) return [column + d / (d - c), row + 1];
        return [column, row + a / (a - d)];
      };
      for (const [from, to] of joins) segment(...on(from), ...on(to));
    }
  }
}
