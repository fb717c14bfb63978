/* SPDX-License-Identifier: Apache-2.0 */
/* The veil from frame to frame; what is made once is in glare_create.c. */
#include "vision/glare/glare.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "include/luminance.h"
#include "include/panorama.h"
#include "vision/picture/simd.hpp"

namespace
{

/* Chosen by hand: docs/maintainers/constants.md. */
/* How well a camera file states a lens' glare, 1 sigma, relative. */
constexpr float kStatedSigma = 0.2F;
/* What so much of the sphere contradicts is less than was stated. Less may be a thing of its own:
 * the rim of a lens, a painted patch. */
constexpr float kContradicted = 0.01F;
constexpr int kBins = 32;
/* What is not contradicted any more counts again: by so much a frame. */
constexpr float kRegained = 0.05F;

constexpr int kWidth = LP_VEIL_WIDTH;

using cv::v_float32x4;

/* Mean light of a lens' picture. */
v_float32x4 mean_light(const struct lp_glare *g, const struct lp_glare_lens &lens)
{
	v_float32x4 sum = cv::v_setzero_f32();

	for (int n = 0; n < LP_VEIL_NODES; n++)
		sum = cv::v_fma(cv::v_load(g->flux[n]), cv::v_setall_f32(lens.source[n]), sum);
	return lens.area_sr > 0.0F ? sum * cv::v_setall_f32(1.0F / lens.area_sr) : sum;
}

/* Add what a lens spreads around. */
void add_spread(struct lp_glare *g, const struct lp_glare_lens &lens)
{
	for (int n = 0; n < LP_VEIL_NODES; n++)
		cv::v_store(g->work[n], cv::v_load(g->flux[n]) * cv::v_setall_f32(lens.into[n]));
	lp_spread_apply(g->spread, g->work, g->work);
	for (int n = 0; n < LP_VEIL_NODES; n++)
		cv::v_store(g->veil[n],
			    cv::v_fma(cv::v_load(g->work[n]),
				      cv::v_setall_f32(g->shares.around * lens.out_of[n]),
				      cv::v_load(g->veil[n])));
}

/* The even veil, and the variance that it has because a panorama does not say its lenses. */
void set_even(struct lp_glare *g)
{
	v_float32x4 mean[LP_MAX_LENSES];

	for (int k = 0; k < g->lens_count; k++)
		mean[k] = mean_light(g, g->lens[k]);
	for (int n = 0; n < LP_VEIL_NODES; n++) {
		v_float32x4 sum = cv::v_setzero_f32(), apart = cv::v_setzero_f32();

		for (int k = 0; k < g->lens_count; k++) {
			const v_float32x4 one =
				mean[k] * cv::v_setall_f32(g->shares.even * g->lens[k].even[n]);

			sum = sum + one;
			apart = k == 0 ? one : apart - one;
		}
		cv::v_store(g->veil[n], sum);
		const float half = g->is_panorama ? cv::v_extract_n<LP_LUMINANCE>(apart) : 0.0F;

		g->variance[n] = half * half;
	}
}

/* By as much of the veil as is believed; variance, and the sigma of all light. */
void weigh(struct lp_glare *g)
{
	const float doubted = 1.0F - g->believed;
	const float relative2 =
		kStatedSigma * kStatedSigma * g->believed * g->believed + doubted * doubted;
	const float shares = g->shares.even + g->shares.around;
	double apart = 0.0, light = 0.0;

	for (int n = 0; n < LP_VEIL_NODES; n++) {
		const float veil = g->veil[n][LP_LUMINANCE];

		apart += static_cast<double>(g->variance[n]) * g->lens[0].source[n];
		light += static_cast<double>(g->flux[n][LP_LUMINANCE]);
		g->variance[n] += relative2 * veil * veil;
		cv::v_store(g->veil[n], cv::v_load(g->veil[n]) * cv::v_setall_f32(g->believed));
	}
	/* 4 pi of the mean is the light of all of the sphere */
	const double half = std::sqrt(apart / LP_VEIL_NODES) * 4.0 * M_PI;

	g->sigma = std::sqrt(relative2) * shares +
		   (light > 0.0 ? static_cast<float>(half / light) : 0.0F);
}

/* Nodes of one row of the panorama, the first again after the last. */
void veil_row(const struct lp_glare *g, int row, float (*nodes)[4])
{
	const float(*above)[4] = g->veil + g->row_node[row] * kWidth;
	const float(*below)[4] = above + kWidth;
	const v_float32x4 share = cv::v_setall_f32(g->row_share[row]);

	for (int k = 0; k < kWidth; k++) {
		const v_float32x4 a = cv::v_load(above[k]);

		cv::v_store(nodes[k], cv::v_fma(cv::v_load(below[k]) - a, share, a));
	}
	std::memcpy(nodes[kWidth], nodes[0], sizeof(nodes[0]));
}

/* How far places contradict the veil: solid angle by the share of it that they allow. */
struct contradictions {
	float sr[kBins] = {};

	void add(float light, float veil, float area_sr)
	{
		if (light < veil)
			sr[std::max(static_cast<int>(light / veil * kBins), 0)] += area_sr;
	}

	/* Share of the veil that so much of the sphere allows. */
	float allowed() const
	{
		float sum = 0.0F;

		for (int k = 0; k < kBins; k++) {
			sum += sr[k];
			if (sum > kContradicted * 4.0F * static_cast<float>(M_PI))
				return (static_cast<float>(k) + 0.5F) / kBins;
		}
		return 1.0F;
	}
};

} /* namespace */

extern "C" float lp_glare_kept(const struct lp_glare *glare)
{
	return glare->known ? 1.0F - glare->believed * (glare->shares.even + glare->shares.around)
			    : 1.0F;
}

/* To the four nodes around each cell. */
extern "C" void lp_glare_add(struct lp_glare *glare, const struct lp_glare_cell *cells, int count)
{
	for (const struct lp_glare_cell *one = cells; one < cells + count; one++) {
		const int row = one->cell / glare->width, column = one->cell - row * glare->width;
		const int left = glare->column_node[column];
		const int right = left + 1 < kWidth ? left + 1 : 0;
		const v_float32x4 flux = cv::v_load(one->light) * cv::v_setall_f32(one->sr);
		const v_float32x4 below = flux * cv::v_setall_f32(glare->row_share[row]);
		const v_float32x4 above = flux - below;
		const v_float32x4 share = cv::v_setall_f32(glare->column_share[column]);
		const v_float32x4 above_right = above * share, below_right = below * share;
		float(*nodes)[4] = glare->flux + glare->row_node[row] * kWidth;

		const auto add = [&](int node, const v_float32x4 &light) {
			cv::v_store(nodes[node], cv::v_load(nodes[node]) + light);
		};

		add(left, above - above_right);
		add(right, above_right);
		add(kWidth + left, below - below_right);
		add(kWidth + right, below_right);
	}
}

extern "C" void lp_glare_spread(struct lp_glare *glare)
{
	glare->believed = glare->allowed < 1.0F ? glare->believed * glare->allowed
						: std::min(glare->believed + kRegained, 1.0F);
	glare->looked = glare->known = true;
	set_even(glare);
	for (int k = 0; k < glare->lens_count; k++)
		if (glare->lens[k].spreads)
			add_spread(glare, glare->lens[k]);
	weigh(glare);
}

extern "C" void lp_glare_take_off(struct lp_glare *glare, const float (*from)[4],
				  const uint8_t *flags, float dark, float (*to)[4])
{
	constexpr uint8_t kNoLight = LP_CELL_UNSEEN | LP_CELL_COVERED | LP_CELL_FILLED;
	const v_float32x4 zero = cv::v_setzero_f32();
	const v_float32x4 inverse = cv::v_setall_f32(1.0F / lp_glare_kept(glare));
	contradictions found;

	for (int r = 0, i = 0; r < glare->height; r++) {
		float nodes[kWidth + 1][4];

		veil_row(glare, r, nodes);
		for (int c = 0; c < glare->width; c++, i++) {
			const int left = glare->column_node[c];
			const v_float32x4 a = cv::v_load(nodes[left]);
			const v_float32x4 veil =
				cv::v_fma(cv::v_load(nodes[left + 1]) - a,
					  cv::v_setall_f32(glare->column_share[c]), a);
			const v_float32x4 light = cv::v_load(from[i]);

			glare->cells[i] = cv::v_extract_n<LP_LUMINANCE>(veil);
			if (!(flags[i] & kNoLight))
				found.add(from[i][LP_LUMINANCE] + dark, glare->cells[i],
					  glare->row_sr[r]);
			cv::v_store(to[i], cv::v_max((light - veil) * inverse, zero));
			to[i][LP_LUMINANCE] = lp_luminance(to[i]);
		}
	}
	if (glare->looked)
		glare->allowed = found.allowed();
	glare->looked = false;
}

extern "C" void lp_glare_at(const struct lp_glare *glare, const float direction[3], float veil[4])
{
	const double theta = std::acos(std::max(-1.0F, std::min(1.0F, direction[1])));
	const double lambda = std::atan2(direction[0], -direction[2]);
	const int row = std::min(static_cast<int>(theta / M_PI * glare->height), glare->height - 1);
	const int column = std::min(static_cast<int>((lambda / (2.0 * M_PI) + 0.5) * glare->width),
				    glare->width - 1);
	float nodes[kWidth + 1][4];

	veil_row(glare, row, nodes);
	const int left = glare->column_node[column];
	const v_float32x4 a = cv::v_load(nodes[left]);

	cv::v_store(veil, cv::v_fma(cv::v_load(nodes[left + 1]) - a,
				    cv::v_setall_f32(glare->column_share[column]), a));
}
