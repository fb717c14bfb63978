/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/map/lookup.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "include/luminance.h"
#include "include/panorama.h"
#include "vision/map/sphere.hpp"

extern "C" {
#include "light/math/grid.h"
#include "light/turn/shear.h"
}

using cv::v_float32x4;

/* Rows whose cells are narrower than this share of their height are averaged before they are read.
 */
static constexpr float kNarrow = 0.5F;

extern "C" void lp_lookup_destroy(struct lp_lookup *lookup)
{
	if (!lookup)
		return;
	std::free(lookup->wide);
	std::free(lookup->smooth);
	std::free(lookup->down);
	std::free(lookup->across);
	std::free(lookup->right);
	std::free(lookup->left);
	std::free(lookup);
}

extern "C" int lp_lookup_create(const struct lp_grid *grid, struct lp_lookup **lookup)
{
	const size_t cells = static_cast<size_t>(grid->width) * grid->height;
	auto *l = static_cast<struct lp_lookup *>(std::calloc(1, sizeof(struct lp_lookup)));

	if (!l)
		return -ENOMEM;
	l->grid = grid;
	l->left = static_cast<int32_t *>(std::calloc(cells, sizeof(*l->left)));
	l->right = static_cast<int32_t *>(std::calloc(cells, sizeof(*l->right)));
	l->across = static_cast<float *>(std::calloc(cells, sizeof(*l->across)));
	l->down = static_cast<float *>(std::calloc(cells, sizeof(*l->down)));
	l->smooth = static_cast<float(*)[4]>(std::calloc(cells, sizeof(*l->smooth)));
	l->wide = static_cast<uint8_t *>(std::calloc(2 * cells, sizeof(*l->wide)));
	if (!l->wide || !l->left || !l->right || !l->across || !l->down || !l->smooth) {
		lp_lookup_destroy(l);
		return -ENOMEM;
	}
	*lookup = l;
	return 0;
}

namespace
{

/* Where the cells of a row lie on the grid that is read: lp::places. Vectors reach beyond the last.
 */
struct row_places {
	float column[LP_PANORAMA_MAX_WIDTH + 4], row[LP_PANORAMA_MAX_WIDTH + 4];
};

void find_places(const struct lp_grid *grid, const struct lp_rotation &rotation, int r,
		 row_places &to)
{
	const lp::turned_row row(rotation, grid->row_sin[r], grid->row_cos[r]);

	for (int c = 0; c < grid->width; c += 4) {
		const v_float32x4 sine = cv::v_load(grid->column_sin + c);
		const v_float32x4 cosine = cv::v_load(grid->column_cos + c);
		const lp::places at(row.at(0, sine, cosine), row.at(1, sine, cosine),
				    row.at(2, sine, cosine), grid->width, grid->height);

		cv::v_store(to.column + c, at.column);
		cv::v_store(to.row + c, at.row);
	}
}

/* The same of a picture whose rows were exposed one after the other. */
void find_sheared(const struct lp_grid *grid, const struct lp_rotation &rotation,
		  const struct lp_shear &shear, int r, row_places &to)
{
	const v_float32x4 half = cv::v_setall_f32(0.5F);
	const cv::v_int32x4 last_row = cv::v_setall_s32(grid->height - 1);
	v_float32x4 turn[3];

	find_places(grid, rotation, r, to);
	for (int a = 0; a < 3; a++)
		turn[a] = cv::v_setall_f32(static_cast<float>(-shear.turn[a]));
	const lp::turned_row row(rotation, grid->row_sin[r], grid->row_cos[r]);

	for (int c = 0; c < grid->width; c += 4) {
		const v_float32x4 sine = cv::v_load(grid->column_sin + c);
		const v_float32x4 cosine = cv::v_load(grid->column_cos + c);
		const v_float32x4 d[3] = {row.at(0, sine, cosine), row.at(1, sine, cosine),
					  row.at(2, sine, cosine)};
		const cv::v_int32x4 width = cv::v_setall_s32(grid->width);
		const cv::v_int32x4 column = cv::v_trunc(cv::v_load(to.column + c) + half);
		const cv::v_int32x4 wrapped = column - (width & (column >= width));
		const cv::v_int32x4 cell_row =
			cv::v_min(cv::v_trunc(cv::v_load(to.row + c) + half), last_row);
		const cv::v_int32x4 cell = cell_row * width + wrapped;
		const v_float32x4 share = cv::v_lut(shear.row_share, cell);
		v_float32x4 seen[3];

		for (int a = 0; a < 3; a++) {
			const int b = (a + 1) % 3, e = (a + 2) % 3;

			seen[a] = cv::v_fma(share, turn[b] * d[e] - turn[e] * d[b], d[a]);
		}
		const lp::places at(seen[0], seen[1], seen[2], grid->width, grid->height);

		cv::v_store(to.column + c, at.column);
		cv::v_store(to.row + c, at.row);
	}
}

/* Those of the row as far from the other pole: half a turn away lies the cell that looks the
 * opposite way, and so it does after any rotation. */
void find_opposite(const struct lp_grid *grid, const row_places &from, row_places &to)
{
	const int width = grid->width, half = width / 2;
	const v_float32x4 half_turn = cv::v_setall_f32(static_cast<float>(half));
	const v_float32x4 middle = half_turn - cv::v_setall_f32(0.5F);
	const v_float32x4 last_row = cv::v_setall_f32(static_cast<float>(grid->height - 1));

	std::rotate_copy(from.column, from.column + half, from.column + width, to.column);
	std::rotate_copy(from.row, from.row + half, from.row + width, to.row);
	for (int c = 0; c < width; c += 4) {
		const v_float32x4 column = cv::v_load(to.column + c);

		cv::v_store(to.column + c,
			    cv::v_select(column < middle, column + half_turn, column - half_turn));
		cv::v_store(to.row + c, last_row - cv::v_load(to.row + c));
	}
}

/* The four cells around each place of row `r`. */
void set_row(struct lp_lookup *lookup, int r, const row_places &at)
{
	const int width = lookup->grid->width, height = lookup->grid->height;
	const v_float32x4 zero = cv::v_setzero_f32(), whole = cv::v_setall_f32(1.0F);
	const v_float32x4 last = cv::v_setall_f32(static_cast<float>(height - 2));
	const cv::v_int32x4 all = cv::v_setall_s32(width), one = cv::v_setall_s32(1);
	const cv::v_int32x4 none = cv::v_setzero_s32();

	for (int c = 0; c < width; c += 4) {
		const v_float32x4 column = cv::v_load(at.column + c), row = cv::v_load(at.row + c);
		const cv::v_int32x4 left = cv::v_floor(column);
		const cv::v_int32x4 top = cv::v_trunc(cv::v_min(cv::v_max(row, zero), last));
		/* -1 and `width` lie on the other side of the seam */
		const cv::v_int32x4 l = left + (all & (left < none)) - (all & ((all - one) < left));
		const cv::v_int32x4 next = l + one, first = top * all;
		const size_t i = static_cast<size_t>(r) * width + c;

		cv::v_store(lookup->left + i, first + l);
		cv::v_store(lookup->right + i, first + next - (all & ((all - one) < next)));
		cv::v_store(lookup->across + i, column - cv::v_cvt_f32(left));
		cv::v_store(lookup->down + i,
			    cv::v_min(cv::v_max(row - cv::v_cvt_f32(top), zero), whole));
	}
}

} /* namespace */

extern "C" void lp_lookup_set(struct lp_lookup *lookup, const struct lp_rotation *rotation)
{
	const struct lp_grid *grid = lookup->grid;
	row_places upper, lower;

	for (int r = 0; r < grid->height / 2; r++) {
		find_places(grid, *rotation, r, upper);
		find_opposite(grid, upper, lower);
		set_row(lookup, r, upper);
		set_row(lookup, grid->height - 1 - r, lower);
	}
}

extern "C" void lp_lookup_set_sheared(struct lp_lookup *lookup, const struct lp_rotation *rotation,
				      const struct lp_shear *shear)
{
	row_places row;

	if (lp_shear_is_none(shear)) {
		lp_lookup_set(lookup, rotation);
		return;
	}
	for (int r = 0; r < lookup->grid->height; r++) {
		find_sheared(lookup->grid, *rotation, *shear, r, row);
		set_row(lookup, r, row);
	}
}

namespace
{

using colour = float[4];

/* Columns to either side of one that are as wide, together, as a row is high. */
int reach_of(const struct lp_grid *grid, int row)
{
	return std::min(static_cast<int>(0.5F / grid->row_sin[row]), grid->width / 2 - 1);
}

/* Mean over `reach` columns to either side, round the row. */
void average_row(const colour *from, int width, int reach, colour *to)
{
	const v_float32x4 share = cv::v_setall_f32(1.0F / static_cast<float>(2 * reach + 1));
	const auto round = [from, width](int c) {
		return cv::v_load(from[c < 0 ? c + width : c < width ? c : c - width]);
	};

	for (int first = 0; first < width; first += 16) {
		v_float32x4 sum = round(first);

		for (int k = 1; k <= reach; k++)
			sum = sum + round(first + k) + round(first - k);
		/* a running sum, begun anew before rounding adds up */
		for (int c = first; c < first + 16 && c < width; c++) {
			cv::v_store(to[c], cv::v_max(sum * share, cv::v_setzero_f32()));
			sum = sum + (round(c + 1 + reach) - round(c - reach));
		}
	}
}

/* `from`, but with rows near the poles averaged: those go to lookup->smooth, and the first rows
 * that are not averaged besides. */
struct readable {
	const colour *middle, *smooth;
	int32_t first, last; /* cells that are read as they are: first .. last - 1 */

	/* Where to read a cell, its row and the one below. */
	const colour *rows_of(int32_t cell) const
	{
		return cell >= first && cell < last ? middle : smooth;
	}
};

readable prepare(struct lp_lookup *lookup, const colour *from)
{
	const struct lp_grid *grid = lookup->grid;
	const int width = grid->width, height = grid->height;
	int rows = 0;

	while (rows < height / 2 && grid->row_sin[rows] < kNarrow)
		rows++;
	for (int r = 0; r < rows; r++) {
		const int reach = reach_of(grid, r);

		for (const int row : {r, height - 1 - r}) {
			const size_t at = static_cast<size_t>(row) * width;

			average_row(from + at, width, reach, lookup->smooth + at);
		}
	}
	for (const int row : {rows, height - 1 - rows}) {
		const size_t at = static_cast<size_t>(row) * width;

		std::memcpy(lookup->smooth + at, from + at, width * sizeof(*from));
	}
	return {from, lookup->smooth, rows * width, (height - 1 - rows) * width};
}

} /* namespace */

extern "C" void lp_lookup_radiance(struct lp_lookup *lookup, const float (*from)[4], float (*to)[4],
				   float *step2)
{
	const int width = lookup->grid->width;
	const int cells = width * lookup->grid->height;
	const readable source = prepare(lookup, from);
	const int32_t *const left = lookup->left, *const right = lookup->right;
	const float *const all_across = lookup->across, *const all_down = lookup->down;

	for (int i = 0; i < cells; i++) {
		const int32_t l = left[i], r = right[i];
		const colour *rows = source.rows_of(l);
		const v_float32x4 a = cv::v_load(rows[l]), b = cv::v_load(rows[r]);
		const v_float32x4 c = cv::v_load(rows[l + width]), d = cv::v_load(rows[r + width]);
		const v_float32x4 across = cv::v_setall_f32(all_across[i]);
		const v_float32x4 down = cv::v_setall_f32(all_down[i]);
		const v_float32x4 upper = cv::v_fma(b - a, across, a);
		const v_float32x4 lower = cv::v_fma(d - c, across, c);
		const v_float32x4 step = (b - a) * (b - a) + (d - c) * (d - c) + (c - a) * (c - a) +
					 (d - b) * (d - b);

		cv::v_store(to[i], cv::v_fma(lower - upper, down, upper));
		step2[i] = 0.5F * cv::v_extract_n<LP_LUMINANCE>(step);
	}
}

extern "C" void lp_lookup_place_variance(const struct lp_lookup *lookup, const float *step2,
					 float least, const double across[3][3], float *variance)
{
	const struct lp_grid *grid = lookup->grid;
	const double(*m)[3] = across;
	const auto all = [](double value) { return cv::v_setall_f32(static_cast<float>(value)); };

	for (int row = 0; row < grid->height; row++) {
		const size_t first = static_cast<size_t>(row) * grid->width;
		const double s = grid->row_sin[row], c = grid->row_cos[row]; /* d: grid.c */
		const v_float32x4 yy = all(least + c * c * m[1][1]);
		const v_float32x4 xy = all(2.0 * s * c * m[0][1]), yz = all(-2.0 * s * c * m[1][2]);
		const v_float32x4 xx = all(s * s * m[0][0]), zz = all(s * s * m[2][2]);
		const v_float32x4 xz = all(-2.0 * s * s * m[0][2]);

		for (int k = 0; k < grid->width; k += 4) {
			const v_float32x4 x = cv::v_load(grid->column_sin + k);
			const v_float32x4 z = cv::v_load(grid->column_cos + k);
			const v_float32x4 of_x = cv::v_fma(xz, z, cv::v_fma(xx, x, xy));
			const v_float32x4 of_z = cv::v_fma(zz, z, yz);
			const v_float32x4 place = cv::v_fma(x, of_x, cv::v_fma(z, of_z, yy));

			cv::v_store(variance + first + k, place * cv::v_load(step2 + first + k));
		}
	}
}

namespace
{

bool any(const uint8_t *marks, size_t count)
{
	return marks[0] || std::memcmp(marks, marks + 1, count - 1) != 0;
}

void mark(uint8_t *cells, const uint8_t *from, int count)
{
	int c = 0;

	for (; c + 16 <= count; c += 16)
		cv::v_store(cells + c, cv::v_load(cells + c) | cv::v_load(from + c));
	for (; c < count; c++)
		cells[c] |= from[c];
}

/* Each cell gets the marks of the four cells from it on to the right and downwards, and those of
 * their neighbours: along the rows, then across them. */
void widen(const struct lp_grid *grid, const uint8_t *from, uint8_t *rows, uint8_t *to)
{
	const int width = grid->width, height = grid->height;

	for (int r = 0; r < height; r++) {
		const uint8_t *in = from + static_cast<size_t>(r) * width;
		uint8_t *out = rows + static_cast<size_t>(r) * width;

		const int reach = std::max(reach_of(grid, r), 1);

		std::memcpy(out, in, width);
		if (!any(in, width))
			continue;
		for (int k = 1; k <= reach + 1; k++) {
			mark(out, in + k, width - k);
			mark(out + width - k, in, k);
			if (k > reach)
				break;
			mark(out + k, in, width - k);
			mark(out, in + width - k, k);
		}
	}
	for (int r = 0; r < height; r++) {
		const uint8_t *in = rows + static_cast<size_t>(r) * width;
		const uint8_t *up = r ? in - width : in, *down = r + 1 < height ? in + width : in;
		const uint8_t *below = r + 2 < height ? down + width : down;
		uint8_t *out = to + static_cast<size_t>(r) * width;

		std::memset(out, 0, width);
		for (const uint8_t *row : {up, in, down, below})
			if (any(row, width))
				mark(out, row, width);
	}
}

} /* namespace */

extern "C" void lp_lookup_marks(struct lp_lookup *lookup, const uint8_t *from, uint8_t *to)
{
	const int width = lookup->grid->width;
	const size_t cells = static_cast<size_t>(width) * lookup->grid->height;

	std::memset(to, 0, cells);
	if (!any(from, cells))
		return;
	widen(lookup->grid, from, lookup->wide + cells, lookup->wide);
	for (size_t i = 0; i < cells; i++) {
		const int32_t l = lookup->left[i], r = lookup->right[i];

		if (lookup->wide[l]) { /* few are */
			const uint8_t own = from[l] | from[r] | from[l + width] | from[r + width];

			/* what is filled is as bright as its neighbours: those are what they are */
			const int near = lookup->wide[l] & ~LP_CELL_FILLED;
			const bool dark = near & ~LP_CELL_CLIPPED;
			const int beside = LP_CELL_BESIDE | (dark ? LP_CELL_BESIDE_DARK : 0);

			to[i] = own ? own : static_cast<uint8_t>(near ? beside : 0);
		}
	}
}

extern "C" void lp_lookup_largest(const struct lp_lookup *lookup, const float *from, float *to)
{
	const int width = lookup->grid->width;

	for (int i = 0; i < width * lookup->grid->height; i++) {
		const int32_t l = lookup->left[i], r = lookup->right[i];

		to[i] = std::max(std::max(from[l], from[r]),
				 std::max(from[l + width], from[r + width]));
	}
}
