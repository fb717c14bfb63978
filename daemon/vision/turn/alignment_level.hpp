/* SPDX-License-Identifier: Apache-2.0 */
/* One resolution of what vision/turn/alignment.cpp compares: the camera's picture, what the
 * radiance map knows there, and the places of the picture that tell something about a turn. */
#ifndef LP_VISION_TURN_ALIGNMENT_LEVEL_HPP
#define LP_VISION_TURN_ALIGNMENT_LEVEL_HPP

#include <cmath>
#include <cstddef>
#include <vector>

#include "vision/map/sphere.hpp"

struct lp_shear;

namespace lp
{

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "While the camera turns". */

/* 1 sigma of log luminance, of what resampling and noise leave of detail, to begin with. */
constexpr float kDetail = 0.1F;
constexpr float kEnough = 0.6F; /* of a pixel must be known */

/* Log luminance on a small grid, and how much of each pixel is known (0 .. 1). */
struct picture {
	std::vector<float> value, weight;

	void resize(size_t pixels)
	{
		value.assign(pixels + 4, 0.0F);
		weight.assign(pixels + 4, 0.0F);
	}
};

/* What is compared of the camera's picture, pixel after pixel. */
struct samples {
	std::vector<float> direction[3], slope[3], value, weight;
	std::vector<float> certainty; /* of `value`: 1 where it is flat, less on steep slopes */
	size_t count;

	void resize(size_t pixels)
	{
		for (int a = 0; a < 3; a++) {
			direction[a].assign(pixels + 4, 0.0F);
			slope[a].assign(pixels + 4, 0.0F);
		}
		value.assign(pixels + 4, 0.0F);
		weight.assign(pixels + 4, 0.0F);
		certainty.assign(pixels + 4, 0.0F);
		count = 0;
	}
};

/* A picture to be read between its pixels: value times weight, and weight, of each; the first and
 * the last column stand on both sides of the seam. */
struct readable {
	int width, height; /* of the picture */
	std::vector<float> pairs;

	void create(int w, int h);
	void fill(const picture &from);

	/* Four places at once; weight 0: too little is known there. */
	void at(const places &where, cv::v_float32x4 &value, cv::v_float32x4 &weight) const;
};

struct level {
	int width, height;
	std::vector<float> column_sin, column_cos; /* of the columns' longitudes */
	picture seen_raw, known_raw, seen, known, scratch;
	readable table; /* of what is known */
	samples list;

	void create(int w, int h);

	/* From seen_raw and known_raw all that is compared. */
	void prepare(const struct lp_shear &shear);

	/* [1 2 1] in both directions, over what is known. */
	void smooth(const picture &from, picture &to);
	/* Slopes of the camera's picture, at every other pixel: how its value changes with a
	 * rotation vector. Smoothed neighbours err alike, so that all pixels tell no more. */
	void collect(const struct lp_shear &shear);

	/* Sum of the weights, if everything could be compared. */
	double all() const
	{
		return 1.0 / M_PI * width * height;
	}
};

} /* namespace lp */

#endif
