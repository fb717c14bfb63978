/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/map/sh_project.h"
#include "vision/picture/simd.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <new>
#include <vector>

#include "include/panorama.h"

extern "C" {
#include "light/math/quadrature.h"
#include "light/math/sh.h"
}

using cv::v_float32x4;
using cv::v_float64x2;

namespace
{

constexpr int kOrders = LP_SH_MAX_ORDER + 1;
constexpr int kCount = LP_SH_MAX_COUNT;

/* index of (l, m >= 0) in a row's table */
constexpr int tri(int l, int m)
{
	return l * (l + 1) / 2 + m;
}

constexpr int kTri = tri(LP_SH_MAX_ORDER, LP_SH_MAX_ORDER) + 1;

} /* namespace */

/*
 * The panorama's pole is +Y, that of the basis +Z. Projection runs in the panorama's own frame,
 * where it separates into rows and columns; a fixed orthogonal matrix per band turns the result.
 */
struct lp_sh_projector {
	int width, height, order;
	std::vector<double>
		rows; /* height * kTri: integral of normalised P_lm * sin over the row */
	/* kOrders * width / 4 * 2: integral of cos, sin(m lambda), each four times over */
	std::vector<float> columns;
	double turn[kCount][2 * LP_SH_MAX_ORDER + 1]; /* row i: band-local matrix */

	void fill_rows();
	void fill_columns();
	void fill_turn();
};

void lp_sh_projector::fill_rows()
{
	constexpr int n = LP_SH_MAX_ORDER;
	double node[n], weight[n], y[kCount];

	lp_gauss_legendre(n, node, weight);
	for (int r = 0; r < height; r++)
		for (int k = 0; k < n; k++) {
			const double theta = M_PI * (r + 0.5 + 0.5 * node[k]) / height;
			const double scale = weight[k] * 0.5 * M_PI / height * std::sin(theta);
			/* azimuth 0 of the panorama's frame: only cos terms, which are P_lm */
			const double d[3] = {0.0, std::cos(theta), std::sin(theta)};

			lp_sh_basis_polar(order, 1, d, y);
			for (int l = 0; l <= order; l++)
				for (int m = 0; m <= l; m++)
					rows[r * kTri + tri(l, m)] += scale * y[l * (l + 1) + m];
		}
}

void lp_sh_projector::fill_columns()
{
	const double step = 2.0 * M_PI / width;

	for (int c = 0; c < width / 4; c++)
		for (int m = 0; m <= order; m++) {
			const double lambda = step * (c + 0.5) - M_PI;
			const double span = m ? 2.0 * std::sin(m * step / 2.0) / m : step;
			/* azimuth of the panorama's frame = pi - lambda */
			const double sign = m % 2 ? -1.0 : 1.0;
			float *out = &columns[(static_cast<size_t>(m) * (width / 4) + c) * 8];

			std::fill_n(out, 4, static_cast<float>(sign * span * std::cos(m * lambda)));
			std::fill_n(out + 4, 4,
				    static_cast<float>(-sign * span * std::sin(m * lambda)));
		}
}

/* turn_l[i][j] = integral of Y_i (pole +Z) times Y_j (pole +Y), by exact quadrature. */
void lp_sh_projector::fill_turn()
{
	constexpr int n = LP_SH_MAX_ORDER + 1, azimuths = 2 * LP_SH_MAX_ORDER + 2;
	double node[n], weight[n], to[kCount], from[kCount];

	lp_gauss_legendre(n, node, weight);
	for (int k = 0; k < n; k++)
		for (int a = 0; a < azimuths; a++) {
			const double sine = std::sqrt(1.0 - node[k] * node[k]);
			const double phi = 2.0 * M_PI * a / azimuths;
			const double d[3] = {sine * std::cos(phi), sine * std::sin(phi), node[k]};

			lp_sh_basis(order, d, to);
			lp_sh_basis_polar(order, 1, d, from);
			for (int l = 0; l <= order; l++)
				for (int i = l * l; i < (l + 1) * (l + 1); i++)
					for (int j = 0; j <= 2 * l; j++)
						turn[i][j] += weight[k] * 2.0 * M_PI / azimuths *
							      to[i] * from[l * l + j];
		}
}

extern "C" int lp_sh_projector_create(int width, int height, int order,
				      struct lp_sh_projector **projector)
{
	if (width <= 0 || width % 8 || width > LP_PANORAMA_MAX_WIDTH || height <= 0 || order < 0 ||
	    order > LP_SH_MAX_ORDER)
		return -EINVAL;
	try {
		auto p = std::make_unique<lp_sh_projector>();

		p->width = width;
		p->height = height;
		p->order = order;
		p->rows.assign(static_cast<size_t>(height) * kTri, 0.0);
		p->columns.assign(static_cast<size_t>(width / 4) * kOrders * 8, 0.0F);
		p->fill_rows();
		p->fill_columns();
		p->fill_turn();
		*projector = p.release();
		return 0;
	} catch (const std::bad_alloc &) {
		return -ENOMEM;
	}
}

extern "C" void lp_sh_projector_destroy(struct lp_sh_projector *projector)
{
	delete projector;
}

namespace
{

/* Four columns that mirror each other at the two axes share one cosine and sine: the row folded to
 * a quarter, for cos and sin of even and odd m. */
struct folded_row {
	static constexpr int kMaxQuarter = LP_PANORAMA_MAX_WIDTH / 4;
	v_float32x4 cosine[2][kMaxQuarter], sine[2][kMaxQuarter];

	void fold(const float (*cells)[4], int width)
	{
		for (int c = 0; c < width / 4; c++) {
			const v_float32x4 a = cv::v_load(cells[c]);
			const v_float32x4 b = cv::v_load(cells[width - 1 - c]);
			const v_float32x4 d = cv::v_load(cells[width / 2 - 1 - c]);
			const v_float32x4 e = cv::v_load(cells[width / 2 + c]);

			cosine[0][c] = (a + b) + (d + e);
			cosine[1][c] = (a + b) - (d + e);
			sine[0][c] = (a - b) - (d - e);
			sine[1][c] = (a - b) + (d - e);
		}
	}
};

/* Sums over one row, R, G and B, luminance. */
struct row_sum {
	v_float64x2 rg, bl;

	explicit row_sum(const v_float32x4 &sum)
	    : rg(cv::v_cvt_f64(sum)), bl(cv::v_cvt_f64_high(sum))
	{
	}
};

/* sum += factor * row, in double */
inline void accumulate(double sum[4], double factor, const row_sum &row)
{
	const v_float64x2 f = cv::v_setall_f64(factor);

	cv::v_store(sum, cv::v_load(sum) + f * row.rg);
	cv::v_store(sum + 2, cv::v_load(sum + 2) + f * row.bl);
}

/* Fourier sums of the rows in float (a quarter of a row each), Legendre sums of those in double. */
void project(const lp_sh_projector &p, const struct lp_panorama &panorama, int order,
	     double (*native)[4])
{
	const int quarter = p.width / 4;
	folded_row row;

	for (int r = 0; r < p.height; r++) {
		const double *legendre = &p.rows[static_cast<size_t>(r) * kTri];

		row.fold(panorama.cells + static_cast<size_t>(r) * p.width, p.width);
		for (int m = 0; m <= order; m++) {
			const float *column = &p.columns[static_cast<size_t>(m) * quarter * 8];
			const v_float32x4 *even = row.cosine[m % 2], *odd = row.sine[m % 2];
			/* two chains each: an addition waits for the one before */
			v_float32x4 c0 = cv::v_setzero_f32(), c1 = c0, s0 = c0, s1 = c0;

			for (int c = 0; c < quarter; c += 2, column += 16) {
				c0 = cv::v_fma(even[c], cv::v_load(column), c0);
				s0 = cv::v_fma(odd[c], cv::v_load(column + 4), s0);
				c1 = cv::v_fma(even[c + 1], cv::v_load(column + 8), c1);
				s1 = cv::v_fma(odd[c + 1], cv::v_load(column + 12), s1);
			}
			const row_sum cosine_sum(c0 + c1), sine_sum(s0 + s1);

			for (int l = m; l <= order; l++) {
				accumulate(native[l * (l + 1) + m], legendre[tri(l, m)],
					   cosine_sum);
				if (m)
					accumulate(native[l * (l + 1) - m], legendre[tri(l, m)],
						   sine_sum);
			}
		}
	}
}

} /* namespace */

extern "C" void lp_sh_project(const struct lp_sh_projector *projector,
			      const struct lp_panorama *panorama, int order, double (*sh)[3])
{
	double native[kCount][4] = {};

	project(*projector, *panorama, order, native);
	for (int l = 0; l <= order; l++)
		for (int i = l * l; i < (l + 1) * (l + 1); i++)
			for (int c = 0; c < 3; c++) {
				sh[i][c] = 0.0;
				for (int j = 0; j <= 2 * l; j++)
					sh[i][c] += projector->turn[i][j] * native[l * l + j][c];
			}
}
