/* SPDX-License-Identifier: Apache-2.0 */
/* Chroma that follows luma: the light of small saturated lamps, and what is left alone. */
#include "vision/picture/tile.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "vision/picture/planes.hpp"

extern "C" {
#include "lp_test.h"
}

namespace
{

struct colour {
	double rgb[3]; /* linear, 1 = full scale */
};

double encode(double linear)
{
	return 255.0 *
	       (linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055);
}

double decode(double code)
{
	const double v = code / 255.0;

	return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

/* A picture and its chroma as a camera averages it. */
struct picture {
	int width, height, h, v;
	std::vector<uint8_t> luma, cb, cr;

	picture(int w, int ht, int h_, int v_)
	    : width(w), height(ht), h(h_), v(v_), luma(static_cast<size_t>(w) * ht), cb(samples()),
	      cr(samples())
	{
	}

	int across() const
	{
		return (width + h - 1) / h;
	}
	size_t samples() const
	{
		return static_cast<size_t>(across()) * ((height + v - 1) / v);
	}

	/* codes(x, y, rgb): of one pixel */
	template <typename Codes> void paint(Codes codes)
	{
		std::vector<double> b(samples()), r(samples()), n(samples());

		for (int y = 0; y < height; y++)
			for (int x = 0; x < width; x++) {
				const size_t chroma = static_cast<size_t>(y / v) * across() + x / h;
				double c[3];

				codes(x, y, c);
				const double l = 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2];

				luma[static_cast<size_t>(y) * width + x] =
					static_cast<uint8_t>(std::lround(l));
				b[chroma] += (c[2] - l) / 1.772;
				r[chroma] += (c[0] - l) / 1.402;
				n[chroma] += 1.0;
			}
		for (size_t i = 0; i < samples(); i++) {
			cb[i] = static_cast<uint8_t>(std::lround(128.0 + b[i] / n[i]));
			cr[i] = static_cast<uint8_t>(std::lround(128.0 + r[i] / n[i]));
		}
	}

	lp::planes planes() const
	{
		return {luma.data(),
			cb.data(),
			cr.data(),
			static_cast<size_t>(width),
			static_cast<size_t>(across()),
			1,
			1,
			width,
			height,
			h,
			v};
	}
};

/* Linear light of all pixels, per channel. */
colour light_of(const std::vector<uint8_t> &rgb)
{
	colour sum = {};

	for (size_t i = 0; i < rgb.size(); i++)
		sum.rgb[i % 3] += decode(rgb[i]);
	return sum;
}

/* Chroma repeated, as a plain decoder does. */
std::vector<uint8_t> repeated(const picture &p)
{
	std::vector<uint8_t> rgb;

	for (int by = 0; by < p.height / 8; by++)
		for (int bx = 0; bx < p.width / 8; bx++) {
			lp::tile tile;
			uint8_t pixels[64][3];

			lp::plane_tile(p.planes(), bx, by, tile);
			lp::tile_rgb(tile, pixels);
			rgb.insert(rgb.end(), pixels[0], pixels[0] + sizeof(pixels));
		}
	return rgb;
}

std::vector<uint8_t> followed(const picture &p)
{
	std::vector<uint8_t> rgb(static_cast<size_t>(p.width) * p.height * 3);

	lp::planes_to_rgb(p.planes(), rgb.data());
	return rgb;
}

double worst(const colour &light, const colour &truth)
{
	double most = 0.0;

	for (int c = 0; c < 3; c++)
		most = std::max(most, std::fabs(light.rgb[c] / truth.rgb[c] - 1.0));
	return most;
}

constexpr colour kLamps[] = {{{0.14, 0.3, 0.7}}, {{0.9, 0.06, 0.04}}, {{0.06, 0.8, 0.1}},
			     {{0.8, 0.4, 0.1}},	 {{0.6, 0.06, 0.8}},  {{0.8, 0.8, 0.8}}};
constexpr double kWall = 0.01;

/* A round lamp of 2.5 pixels before a wall; 1 = all of the pixel. */
double lamp_share(int x, int y, double x0, double y0)
{
	double inside = 0.0;

	for (int s = 0; s < 64; s++)
		inside += std::hypot(x + (s % 8 + 0.5) / 8 - x0, y + (s / 8 + 0.5) / 8 - y0) < 2.5;
	return inside / 64.0;
}

/* At several places between the chroma samples, and across tiles. */
void test_small_lamps_keep_their_colour(void **)
{
	double plain = 0.0;

	for (const colour &lamp : kLamps)
		for (int place = 0; place < 10; place++) {
			picture p(16, 16, 2, place % 2 + 1);
			const double x0 = 4.3 + 0.6 * place, y0 = 4.7 + 0.4 * place;
			colour truth = {};

			p.paint([&](int x, int y, double codes[3]) {
				const double inside = lamp_share(x, y, x0, y0);

				for (int c = 0; c < 3; c++) {
					codes[c] = std::round(encode(kWall + inside * lamp.rgb[c]));
					truth.rgb[c] += decode(codes[c]);
				}
			});
			plain = std::max(plain, worst(light_of(repeated(p)), truth));
			assert_true(worst(light_of(followed(p)), truth) < 0.02);
		}
	assert_true(plain > 0.1); /* what this is for */
}

/* Where luma is even, where chroma is, and where chroma has a sample per pixel. */
void test_the_rest_is_left_alone(void **)
{
	const int samplings[][2] = {{2, 2}, {2, 1}, {1, 2}, {1, 1}};

	for (const auto &s : samplings)
		for (int kind = 0; kind < 2; kind++) {
			picture p(32, 32, s[0], s[1]);

			for (size_t i = 0; i < p.luma.size(); i++)
				p.luma[i] = static_cast<uint8_t>(kind ? 120
								      : 60 + 11 * i * i / 7 % 120);
			for (size_t i = 0; i < p.samples(); i++) {
				const bool any = kind || s[0] == 1;

				p.cb[i] = static_cast<uint8_t>(any ? 100 + 13 * i % 50 : 140);
				p.cr[i] = static_cast<uint8_t>(any ? 110 + 7 * i % 30 : 110);
			}
			const colour a = light_of(repeated(p)), b = light_of(followed(p));

			for (int c = 0; c < 3; c++)
				assert_float_equal(a.rgb[c], b.rgb[c], 1e-9);
		}
}

void test_grey(void **)
{
	picture p(16, 8, 1, 1);
	lp::planes planes = p.planes();
	std::vector<uint8_t> rgb(p.luma.size() * 3);

	for (size_t i = 0; i < p.luma.size(); i++)
		p.luma[i] = static_cast<uint8_t>(2 * i);
	planes.cb = planes.cr = nullptr;
	lp::planes_to_rgb(planes, rgb.data());
	for (size_t i = 0; i < rgb.size(); i++)
		assert_int_equal(rgb[i], p.luma[i / 3]);
}

/* Sizes that end in part of a tile, and of a chroma sample. */
void test_edges(void **)
{
	for (int width = 1; width <= 17; width++) {
		picture p(width, 19 - width, 2, 2);

		p.paint([](int, int, double codes[3]) {
			codes[0] = 200.0;
			codes[1] = 100.0;
			codes[2] = 50.0;
		});
		const std::vector<uint8_t> rgb = followed(p);

		for (size_t i = 0; i < rgb.size(); i++)
			assert_true(std::abs(rgb[i] - (i % 3 == 0   ? 200
						       : i % 3 == 1 ? 100
								    : 50)) <= 1);
	}
}

} /* namespace */

int main()
{
	const CMUnitTest tests[] = {
		cmocka_unit_test(test_small_lamps_keep_their_colour),
		cmocka_unit_test(test_the_rest_is_left_alone),
		cmocka_unit_test(test_grey),
		cmocka_unit_test(test_edges),
	};

	return cmocka_run_group_tests(tests, nullptr, nullptr);
}
