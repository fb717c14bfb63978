/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/camera/remap.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <numeric>
#include <vector>

#include "include/panorama.h"
#include "vision/camera/camera.h"
#include "vision/picture/cells.h"
#include "vision/picture/simd.hpp"

namespace
{

struct entry {
	int source;
	double weight; /* share of the panorama cell's solid angle */
	double illumination;
};

using matrix = std::vector<std::vector<entry>>;

int cells_across(int pixels, int cell_px)
{
	return (pixels + cell_px - 1) / cell_px;
}

/* Overlaps of `n` equal intervals with the cells of `pixels` pixels, in the measure `at`: fraction
 * [0, 1] -> cumulative measure. */
template <typename Measure> matrix overlaps(int n, int pixels, int cell_px, Measure at)
{
	const int cells = cells_across(pixels, cell_px);
	matrix result(n);

	for (int i = 0; i < n; i++) {
		const double low = static_cast<double>(i) / n, high = (i + 1.0) / n;

		for (int k = 0; k < cells; k++) {
			const double a = std::max(low, static_cast<double>(k) * cell_px / pixels);
			const double b = std::min(
				high, std::min(static_cast<double>(k + 1) * cell_px / pixels, 1.0));

			if (b - a > 1e-9)
				result[i].push_back(
					{k, (at(b) - at(a)) / (at(high) - at(low)), 1.0});
		}
	}
	return result;
}

/* Equirectangular to equirectangular: rows and columns overlap separately and exactly. */
matrix map_equirect(int width_px, int height_px, int cell_px, int width, int height)
{
	const int across = cells_across(width_px, cell_px);
	const matrix columns = overlaps(width, width_px, cell_px, [](double f) { return f; });
	const matrix rows =
		overlaps(height, height_px, cell_px, [](double f) { return -std::cos(M_PI * f); });
	matrix result(static_cast<size_t>(width) * height);

	for (int r = 0; r < height; r++)
		for (int c = 0; c < width; c++)
			for (const entry &row : rows[r])
				for (const entry &column : columns[c])
					result[static_cast<size_t>(r) * width + c].push_back(
						{row.source * across + column.source,
						 row.weight * column.weight, 1.0});
	return result;
}

/* What one direction sees, over all lenses. */
void sample(const struct lp_camera &camera, int width_px, int height_px, int cell_px,
	    const double d[3], double weight, std::vector<entry> &row)
{
	const int across = cells_across(width_px, cell_px);
	entry seen[LP_MAX_LENSES];
	double total = 0.0;
	int count = 0;

	for (int lens = 0; lens < camera.lens_count; lens++) {
		double pixel[2], share, illumination;

		if (!lp_camera_project(&camera, lens, width_px, height_px, d, pixel, &share,
				       &illumination))
			continue;
		const int x = std::min(static_cast<int>(pixel[0]), width_px - 1) / cell_px;
		const int y = std::min(static_cast<int>(pixel[1]), height_px - 1) / cell_px;

		seen[count++] = {y * across + x, share, illumination};
		total += share;
	}
	for (int k = 0; k < count; k++) {
		const double part = weight * seen[k].weight / total;
		const auto same = std::find_if(row.begin(), row.end(), [&](const entry &e) {
			return e.source == seen[k].source;
		});

		if (same != row.end()) {
			same->illumination =
				(same->illumination * same->weight + seen[k].illumination * part) /
				(same->weight + part);
			same->weight += part;
		} else {
			row.push_back({seen[k].source, part, seen[k].illumination});
		}
	}
}

double row_solid_angle(int row, int width, int height)
{
	return 2.0 * M_PI / width *
	       (std::cos(M_PI * row / height) - std::cos(M_PI * (row + 1) / height));
}

/*
 * Sampling gives a camera cell now too much, now too little weight. Scale columns to the light they
 * hold and rows to 1 in turn (Sinkhorn & Knopp 1967) until both nearly hold.
 */
void balance(const struct lp_camera &camera, int width_px, int height_px, int cell_px, int width,
	     int height, matrix &rows)
{
	const int across = cells_across(width_px, cell_px);
	const int count = across * cells_across(height_px, cell_px);
	std::vector<double> holds(count, 0.0), given(count), covered(rows.size(), 0.0);

	std::vector<bool> used(count, false);
	for (const auto &row : rows)
		for (const entry &e : row)
			used[e.source] = true;
	for (int k = 0; k < count;
	     k++) { /* 2 x 2 samples of the solid angle per pixel are plenty */
		const double x0 = k % across * cell_px, y0 = k / across * cell_px;

		for (int s = 0; s < 16 && used[k]; s++)
			holds[k] +=
				lp_camera_pixel_solid_angle_sr(&camera, width_px, height_px,
							       x0 + cell_px * (s % 4 + 0.5) / 4.0,
							       y0 + cell_px * (s / 4 + 0.5) / 4.0) *
				cell_px * cell_px / 16.0;
	}
	for (size_t i = 0; i < rows.size(); i++)
		for (const entry &e : rows[i])
			covered[i] += e.weight;
	for (int iteration = 0; iteration < 12; iteration++) {
		std::fill(given.begin(), given.end(), 0.0);
		for (size_t i = 0; i < rows.size(); i++)
			for (const entry &e : rows[i])
				given[e.source] +=
					e.weight *
					row_solid_angle(static_cast<int>(i) / width, width, height);
		for (size_t i = 0; i < rows.size(); i++) {
			double total = 0.0;

			for (entry &e : rows[i]) {
				/* at seams and rims a cell serves only in part: leave those */
				const double ratio = holds[e.source] / given[e.source];

				if (ratio > 0.7 && ratio < 1.4)
					e.weight *= ratio;
				total += e.weight;
			}
			for (entry &e : rows[i])
				e.weight *= covered[i] / total;
		}
	}
}

matrix map_lenses(const struct lp_camera &camera, int width_px, int height_px, int cell_px,
		  int width, int height)
{
	constexpr int samples = 5; /* a side */
	matrix rows(static_cast<size_t>(width) * height);

	for (int i = 0; i < width * height; i++) {
		const int r = i / width, c = i % width;
		const double top = std::cos(M_PI * r / height);
		const double bottom = std::cos(M_PI * (r + 1) / height);

		for (int s = 0; s < samples * samples; s++) {
			/* equal solid angles: even in the cosine */
			const double y = top + (bottom - top) * (s / samples + 0.5) / samples;
			const double l =
				2.0 * M_PI * ((c + (s % samples + 0.5) / samples) / width - 0.5);
			const double sine = std::sqrt(std::max(0.0, 1.0 - y * y));
			const double d[3] = {sine * std::sin(l), y, -sine * std::cos(l)};

			sample(camera, width_px, height_px, cell_px, d, 1.0 / (samples * samples),
			       rows[i]);
		}
	}
	balance(camera, width_px, height_px, cell_px, width, height, rows);
	return rows;
}

bool is_identity(const matrix &rows, int sources)
{
	if (static_cast<int>(rows.size()) != sources)
		return false;
	for (size_t i = 0; i < rows.size(); i++)
		if (rows[i].size() != 1 || rows[i][0].source != static_cast<int>(i))
			return false;
	return true;
}

template <typename T> T *array_of(size_t count)
{
	return static_cast<T *>(std::calloc(count + 1, sizeof(T)));
}

/* Panorama cells by the number of their entries. */
std::vector<int> by_length(const matrix &rows)
{
	std::vector<int> order(rows.size());

	std::iota(order.begin(), order.end(), 0);
	std::stable_sort(order.begin(), order.end(),
			 [&](int a, int b) { return rows[a].size() < rows[b].size(); });
	return order;
}

/* Which panorama cells take from each camera cell. */
void fill_targets(struct lp_remap *remap, int rows)
{
	for (int k = 0; k < remap->first[rows]; k++)
		remap->target_first[remap->source[k] + 1]++;
	for (int s = 0; s < remap->sources; s++)
		remap->target_first[s + 1] += remap->target_first[s];
	std::vector<int> next(remap->target_first, remap->target_first + remap->sources);
	for (int i = 0; i < rows; i++)
		for (int k = remap->first[i]; k < remap->first[i + 1]; k++)
			remap->target[next[remap->source[k]]++] = remap->order[i];
}

/* The camera cells that some row takes from. */
void fill_seen(struct lp_remap *remap)
{
	const int across = cells_across(remap->width_px, remap->cell_px);

	for (int k = 0; k < remap->sources; k++) {
		const int column = k % across;

		if (remap->given_sr[k] > 0.0F)
			remap->seen[k / across * LP_QUADS(across) + column / 4] |= 1 << column % 4;
	}
}

/* A cell seen in part takes the radiance of the part; gives how much of it is seen. */
double fill_row(struct lp_remap *remap, const std::vector<entry> &row, int first, double omega)
{
	double covered = 0.0;

	for (const entry &e : row)
		covered += e.weight;
	for (const entry &e : row) {
		remap->source[first] = e.source;
		remap->weight[first] = static_cast<float>(e.weight / covered / e.illumination);
		remap->given_sr[e.source] += remap->weight[first++] * static_cast<float>(omega);
	}
	return covered;
}

/* In the picture, the mean height of what a panorama cell sees. */
float row_share(const struct lp_remap *remap, const std::vector<entry> &row)
{
	const int columns = cells_across(remap->width_px, remap->cell_px);
	double sum = 0.0, covered = 0.0;

	for (const entry &e : row) {
		const double y_px = (e.source / columns + 0.5) * remap->cell_px;

		sum += e.weight * (y_px / remap->height_px - 0.5);
		covered += e.weight;
	}
	return covered > 0.0 ? static_cast<float>(sum / covered) : 0.0F;
}

int compress(const matrix &rows, int sources, struct lp_remap *remap)
{
	const std::vector<int> order = by_length(rows);
	const int cells = static_cast<int>(rows.size());
	size_t count = 0;
	double seen = 0.0;

	for (const auto &row : rows)
		count += row.size();
	remap->sources = sources;
	remap->order = array_of<int>(cells);
	remap->first = array_of<int>(cells);
	remap->row = array_of<int>(cells);
	remap->source = array_of<int>(count);
	remap->weight = array_of<float>(count);
	remap->given_sr = array_of<float>(sources);
	remap->seen = array_of<uint8_t>(sources); /* more than enough */
	remap->unseen = array_of<uint8_t>(cells);
	remap->row_share = array_of<float>(cells);
	remap->target_first = array_of<int>(sources);
	remap->target = array_of<int>(count);
	if (!remap->order || !remap->first || !remap->row || !remap->source || !remap->weight ||
	    !remap->given_sr || !remap->seen || !remap->unseen || !remap->row_share ||
	    !remap->target_first || !remap->target)
		return -ENOMEM;
	for (int i = 0; i < cells; i++) {
		const int cell = order[i];
		const double omega =
			row_solid_angle(cell / remap->width, remap->width, remap->height);

		remap->order[i] = cell;
		remap->row[cell] = i;
		remap->row_share[cell] = row_share(remap, rows[cell]);
		if (fill_row(remap, rows[cell], remap->first[i], omega) > 0.0)
			seen += omega;
		else
			remap->unseen[cell] = LP_CELL_UNSEEN;
		remap->first[i + 1] = remap->first[i] + static_cast<int>(rows[cell].size());
		for (size_t n = rows[cell].size(); n <= LP_REMAP_SHORT; n++)
			remap->rows_end[n] = i + 1;
	}
	fill_targets(remap, cells);
	fill_seen(remap);
	seen /= 4.0 * M_PI;
	remap->seen_fraction = seen > 0.9999 ? 1.0F : static_cast<float>(seen);
	return 0;
}

} /* namespace */

extern "C" int lp_remap_create(const struct lp_camera *camera, int width_px, int height_px,
			       int cell_px, int panorama_width, struct lp_remap **remap)
try {
	const int height = panorama_width / 2;
	auto *r = static_cast<struct lp_remap *>(std::calloc(1, sizeof(struct lp_remap)));
	int ret;

	if (!r)
		return -ENOMEM;
	r->width = panorama_width;
	r->height = height;
	r->width_px = width_px;
	r->height_px = height_px;
	r->cell_px = cell_px;
	const matrix rows =
		lp_camera_is_whole(camera)
			? map_equirect(width_px, height_px, cell_px, panorama_width, height)
			: map_lenses(*camera, width_px, height_px, cell_px, panorama_width, height);
	const int sources = cells_across(width_px, cell_px) * cells_across(height_px, cell_px);

	r->identity = lp_camera_is_whole(camera) && is_identity(rows, sources);
	ret = compress(rows, sources, r);
	if (ret < 0) {
		lp_remap_destroy(r);
		return ret;
	}
	*remap = r;
	return 0;
} catch (const std::bad_alloc &) {
	return -ENOMEM;
}

extern "C" void lp_remap_destroy(struct lp_remap *remap)
{
	if (!remap)
		return;
	for (void *array :
	     {static_cast<void *>(remap->order), static_cast<void *>(remap->first),
	      static_cast<void *>(remap->row), static_cast<void *>(remap->source),
	      static_cast<void *>(remap->weight), static_cast<void *>(remap->given_sr),
	      static_cast<void *>(remap->seen), static_cast<void *>(remap->unseen),
	      static_cast<void *>(remap->row_share), static_cast<void *>(remap->target),
	      static_cast<void *>(remap->target_first)})
		std::free(array);
	std::free(remap);
}

/* A panorama cell is clipped when any camera cell in it is. */
static void mark_clipped(const struct lp_remap *remap, const struct lp_cells *cells, uint8_t *flags)
{
	const uint8_t *clipped = cells->clipped, *end = clipped + remap->sources;

	while ((clipped = static_cast<const uint8_t *>(std::memchr(clipped, 1, end - clipped)))) {
		const long source = clipped++ - cells->clipped;

		for (int k = remap->target_first[source]; k < remap->target_first[source + 1]; k++)
			flags[remap->target[k]] = LP_CELL_CLIPPED;
	}
}

/* Flagged cells of a row, eight at a time; widths are multiples of eight. */
static int count_clipped(const uint8_t *flags, int width)
{
	uint64_t sum = 0;

	for (int i = 0; i < width; i += 8) {
		uint64_t eight;

		std::memcpy(&eight, flags + i, sizeof(eight));
		sum += __builtin_popcountll(eight & 0x0101010101010101ULL * LP_CELL_CLIPPED);
	}
	return static_cast<int>(sum);
}

static float clipped_fraction(const struct lp_remap *remap, const uint8_t *flags)
{
	double sum = 0.0;

	for (int r = 0; r < remap->height; r++) {
		const int clipped = count_clipped(flags + r * remap->width, remap->width);

		if (clipped)
			sum += clipped * row_solid_angle(r, remap->width, remap->height);
	}
	return static_cast<float>(sum / (4.0 * M_PI));
}

namespace
{

/* Rows with `Count` entries each, from row `from` to before row `to`. */
template <int Count>
void apply_rows(const struct lp_remap *remap, const float (*radiance)[4], int from, int to,
		float (*out)[4])
{
	const int *source = remap->source + remap->first[from];
	const float *weight = remap->weight + remap->first[from];
	const int *order = remap->order + from, *const end = remap->order + to;

	for (; order < end; order++, source += Count, weight += Count) {
		cv::v_float32x4 sum = cv::v_setzero_f32();

		for (int k = 0; k < Count; k++)
			sum = cv::v_fma(cv::v_load(radiance[source[k]]),
					cv::v_setall_f32(weight[k]), sum);
		cv::v_store(out[*order], sum);
	}
}

/* Rows with any number of entries. */
void apply_long_rows(const struct lp_remap *remap, const float (*radiance)[4], int from, int to,
		     float (*out)[4])
{
	for (int i = from; i < to; i++) {
		cv::v_float32x4 sum = cv::v_setzero_f32();

		for (int k = remap->first[i]; k < remap->first[i + 1]; k++)
			sum = cv::v_fma(cv::v_load(radiance[remap->source[k]]),
					cv::v_setall_f32(remap->weight[k]), sum);
		cv::v_store(out[remap->order[i]], sum);
	}
}

/* Loops whose length is known when they are compiled are unrolled: most rows are short. */
void apply_all_rows(const struct lp_remap *remap, const float (*radiance)[4], float (*out)[4])
{
	const int *end = remap->rows_end;

	static_assert(LP_REMAP_SHORT == 4);
	apply_rows<0>(remap, radiance, 0, end[0], out);
	apply_rows<1>(remap, radiance, end[0], end[1], out);
	apply_rows<2>(remap, radiance, end[1], end[2], out);
	apply_rows<3>(remap, radiance, end[2], end[3], out);
	apply_rows<4>(remap, radiance, end[3], end[4], out);
	apply_long_rows(remap, radiance, end[4], remap->width * remap->height, out);
}

} /* namespace */

extern "C" void lp_remap_apply(const struct lp_remap *remap, const struct lp_cells *cells,
			       struct lp_panorama *panorama)
{
	if (!remap->identity) {
		apply_all_rows(remap, cells->radiance, panorama->cells);
		std::memcpy(panorama->flags, remap->unseen,
			    static_cast<size_t>(remap->width) * remap->height);
		if (cells->clipped_count)
			mark_clipped(remap, cells, panorama->flags);
	}
	panorama->seen_fraction = remap->seen_fraction;
	panorama->clipped_fraction =
		cells->clipped_count ? clipped_fraction(remap, panorama->flags) : 0.0F;
}
