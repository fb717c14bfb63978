/* SPDX-License-Identifier: Apache-2.0 */
/* JPEG to spherical harmonics of order 2 over all pixels of an equirectangular picture: pixel by
 * pixel as in text books, and separated into rows and columns. */
#include <array>
#include <cmath>
#include <cstdio>

#include "contestant.hpp"

extern "C" {
#include "light/math/sh.h"
}

namespace
{

constexpr int kOrder = 2, kCount = 9;

double srgb_to_linear(double code)
{
	const double v = code / 255.0;

	return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

std::array<float, 256> srgb_table()
{
	std::array<float, 256> table;

	for (int code = 0; code < 256; code++)
		table[code] = static_cast<float>(srgb_to_linear(code));
	return table;
}

struct projection : bench::contestant {
	bench::decoder decoder;
	double sh[kCount][3] = {};

	using contestant::contestant;

	std::string result() const override
	{
		std::string text = "[";

		for (int i = 0; i < kCount; i++) {
			char row[100];

			std::snprintf(row, sizeof(row), "%s[%.9g, %.9g, %.9g]", i ? ", " : "",
				      sh[i][0], sh[i][1], sh[i][2]);
			text += row;
		}
		return text + "]";
	}
};

double row_solid_angle_sr(int row, int width, int height)
{
	return (std::cos(M_PI * row / height) - std::cos(M_PI * (row + 1) / height)) * 2.0 * M_PI /
	       width;
}

struct naive final : projection {
	naive() : projection("sh_naive_cpp")
	{
	}

	void run(const bench::picture &p) override
	{
		decoder.decode(p);
		const int width = decoder.width_px, height = decoder.height_px;

		for (auto &row : sh)
			row[0] = row[1] = row[2] = 0.0;
		for (int y = 0; y < height; y++)
			for (int x = 0; x < width; x++) {
				const double t = M_PI * (y + 0.5) / height;
				const double l = 2.0 * M_PI * ((x + 0.5) / width - 0.5);
				const double d[3] = {std::sin(t) * std::sin(l), std::cos(t),
						     -std::sin(t) * std::cos(l)};
				const uint8_t *rgb =
					&decoder.rgb[(static_cast<size_t>(y) * width + x) * 3];
				double basis[kCount];

				lp_sh_basis(kOrder, d, basis);
				const double omega = row_solid_angle_sr(y, width, height);
				for (int c = 0; c < 3; c++) {
					const double light = srgb_to_linear(rgb[c]) * omega;

					for (int i = 0; i < kCount; i++)
						sh[i][c] += basis[i] * light;
				}
			}
	}
};

/* Rows to their Fourier sums of order <= 2, then those to the nine coefficients. */
struct separable final : projection {
	const std::array<float, 256> linear = srgb_table();
	std::vector<std::array<float, 5>> columns; /* 1, sin, cos, sin 2, cos 2 of longitude */

	separable() : projection("sh_separable_cpp")
	{
	}

	void prepare(int width)
	{
		columns.resize(width);
		for (int x = 0; x < width; x++) {
			const double l = 2.0 * M_PI * ((x + 0.5) / width - 0.5);

			columns[x] = {1.0F, static_cast<float>(std::sin(l)),
				      static_cast<float>(std::cos(l)),
				      static_cast<float>(std::sin(2.0 * l)),
				      static_cast<float>(std::cos(2.0 * l))};
		}
	}

	void sum_row(const uint8_t *rgb, int width, float sum[3][5]) const
	{
		for (int x = 0; x < width; x++)
			for (int c = 0; c < 3; c++) {
				const float light = linear[rgb[3 * x + c]];

				for (int k = 0; k < 5; k++)
					sum[c][k] += light * columns[x][k];
			}
	}

	/* d = (s sin l, z, -s cos l), s and z of the row's polar angle; basis of sh.c. */
	void add_row(const float f[3][5], double s, double z, double omega)
	{
		const double k0 = std::sqrt(1.0 / (4.0 * M_PI)), k1 = std::sqrt(3.0 / (4.0 * M_PI));
		const double k2 = std::sqrt(15.0 / (4.0 * M_PI));
		const double k20 = std::sqrt(5.0 / (16.0 * M_PI));

		for (int c = 0; c < 3; c++) {
			const double a = omega * static_cast<double>(f[c][0]);
			const double sn = omega * static_cast<double>(f[c][1]);
			const double cs = omega * static_cast<double>(f[c][2]);
			const double sn2 = omega * static_cast<double>(f[c][3]);
			const double cs2 = omega * static_cast<double>(f[c][4]);

			sh[0][c] += k0 * a;
			sh[1][c] += k1 * z * a;				 /* y */
			sh[2][c] += -k1 * s * cs;			 /* z */
			sh[3][c] += k1 * s * sn;			 /* x */
			sh[4][c] += k2 * s * z * sn;			 /* x y */
			sh[5][c] += -k2 * s * z * cs;			 /* y z */
			sh[6][c] += k20 * (1.5 * s * s * (a + cs2) - a); /* 3 z^2 - 1 */
			sh[7][c] += -k2 * 0.5 * s * s * sn2;		 /* x z */
			sh[8][c] +=
				0.5 * k2 * (0.5 * s * s * (a - cs2) - z * z * a); /* x^2 - y^2 */
		}
	}

	void run(const bench::picture &p) override
	{
		decoder.decode(p);
		const int width = decoder.width_px, height = decoder.height_px;

		if (static_cast<int>(columns.size()) != width)
			prepare(width);
		for (auto &row : sh)
			row[0] = row[1] = row[2] = 0.0;
		for (int y = 0; y < height; y++) {
			const double t = M_PI * (y + 0.5) / height;
			float sum[3][5] = {};

			sum_row(&decoder.rgb[static_cast<size_t>(y) * width * 3], width, sum);
			add_row(sum, std::sin(t), std::cos(t),
				row_solid_angle_sr(y, width, height));
		}
	}
};

} /* namespace */

void bench::add_projections(contestants &list)
{
	list.push_back(std::make_unique<naive>());
	list.push_back(std::make_unique<separable>());
}
