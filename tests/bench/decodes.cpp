/* SPDX-License-Identifier: Apache-2.0 */
/* Plain decodes by libjpeg-turbo: 1/1 is the yardstick of everything else. */
#include <turbojpeg.h>

#include "contestant.hpp"

bench::decoder::decoder(int its_divisor) : divisor(its_divisor), turbo(tjInitDecompress())
{
}

bench::decoder::~decoder()
{
	tjDestroy(turbo);
}

void bench::decoder::decode(const picture &p)
{
	const tjscalingfactor factor = {1, divisor};

	width_px = TJSCALED(p.width_px, factor);
	height_px = TJSCALED(p.height_px, factor);
	rgb.resize(static_cast<size_t>(width_px) * height_px * 3);
	if (tjDecompress2(turbo, p.jpeg.data(), p.jpeg.size(), rgb.data(), width_px, 0, height_px,
			  TJPF_RGB, 0) < 0)
		die("decode", tjGetErrorStr2(turbo));
}

namespace
{

struct plain_decode final : bench::contestant {
	bench::decoder decoder;

	explicit plain_decode(int divisor)
	    : contestant("decode_1_" + std::to_string(divisor)), decoder(divisor)
	{
	}
	void run(const bench::picture &p) override
	{
		decoder.decode(p);
	}
};

} /* namespace */

void bench::add_decodes(contestants &list)
{
	for (const int divisor : {1, 2, 4, 8})
		list.push_back(std::make_unique<plain_decode>(divisor));
}
