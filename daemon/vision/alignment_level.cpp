/* SPDX-License-Identifier: Apache-2.0 */
#include "vision/alignment_level.hpp"

#include <algorithm>

namespace lp
{

namespace
{

/* Chosen by hand, as those of the header. */
constexpr float kPlace = 0.15F;	     /* 1 sigma, in pixels, of where detail within one lies */
constexpr float kLeastSlope = 0.01F; /* log luminance per pixel: flatter ones say nothing */

} /* namespace */

void level::create(int w, int h)
{
	width = w;
	height = h;
	for (int x = 0; x < w; x++) {
		const double lambda = 2.0 * M_PI * ((x + 0.5) / w - 0.5);

		column_sin.push_back(static_cast<float>(std::sin(lambda)));
		column_cos.push_back(static_cast<float>(std::cos(lambda)));
	}
	for (picture *p : {&seen, &known, &scratch})
		p->resize(static_cast<size_t>(w) * h);
	list.resize(static_cast<size_t>(w) * h);
}

void level::smooth(picture &p)
{
	for (int y = 0; y < height; y++)
		for (int x = 0; x < width; x++) {
			const int row = y * width, left = row + (x ? x - 1 : width - 1);
			const int right = row + (x + 1 < width ? x + 1 : 0), at = row + x;
			const float l = p.weight[left], m = 2.0F * p.weight[at],
				    r = p.weight[right], all = l + m + r;

			scratch.value[at] = all > 0.0F ? (l * p.value[left] + m * p.value[at] +
							  r * p.value[right]) /
								 all
						       : 0.0F;
			scratch.weight[at] = 0.25F * all;
		}
	for (int y = 0; y < height; y++) {
		const int up = std::max(y - 1, 0) * width,
			  down = std::min(y + 1, height - 1) * width;

		for (int x = 0; x < width; x++) {
			const int at = y * width + x;
			const float u = scratch.weight[up + x], m = 2.0F * scratch.weight[at],
				    d = scratch.weight[down + x], all = u + m + d;

			p.value[at] = all > 0.0F
					      ? (u * scratch.value[up + x] + m * scratch.value[at] +
						 d * scratch.value[down + x]) /
							all
					      : 0.0F;
			p.weight[at] = 0.25F * all;
		}
	}
}

void level::collect()
{
	list.count = 0;
	for (int y = 1; y + 1 < height; y++) {
		const double theta = M_PI * (y + 0.5) / height;
		const float st = static_cast<float>(std::sin(theta));
		const float ct = static_cast<float>(std::cos(theta));
		const float per_theta = static_cast<float>(height / M_PI) / 2.0F;
		const float per_lambda = static_cast<float>(width / (2.0 * M_PI)) / (2.0F * st);

		for (int x = y % 2; x < width; x += 2) {
			const int row = y * width, at = row + x;
			const int left = row + (x ? x - 1 : width - 1);
			const int right = row + (x + 1 < width ? x + 1 : 0);
			const float least =
				std::min(std::min(seen.weight[left], seen.weight[right]),
					 std::min(seen.weight[at - width],
						  seen.weight[at + width]));

			if (least < kEnough)
				continue;
			const float gy = seen.value[at + width] - seen.value[at - width];
			const float gx = seen.value[right] - seen.value[left];

			if (gx * gx + gy * gy < 4.0F * kLeastSlope * kLeastSlope)
				continue;
			const float sl = column_sin[x], cl = column_cos[x];
			const float d[3] = {st * sl, ct, -st * cl};
			const float g[3] = {ct * sl * gy * per_theta + cl * gx * per_lambda,
					    -st * gy * per_theta,
					    -ct * cl * gy * per_theta + sl * gx * per_lambda};
			const float steep = kPlace / (2.0F * kDetail);
			const float certainty =
				1.0F / std::sqrt(1.0F + steep * steep * (gx * gx + gy * gy));
			const size_t k = list.count++;

			for (int a = 0; a < 3; a++) {
				list.direction[a][k] = d[a];
				list.slope[a][k] = certainty * (d[(a + 1) % 3] * g[(a + 2) % 3] -
								d[(a + 2) % 3] * g[(a + 1) % 3]);
			}
			list.certainty[k] = certainty;
			list.value[k] = seen.value[at];
			list.weight[k] = st * seen.weight[at];
		}
	}
	for (size_t k = list.count; k < list.count + 4; k++) /* vectors reach beyond the last */
		list.weight[k] = 0.0F;
}

} /* namespace lp */
