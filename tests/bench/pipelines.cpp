/* SPDX-License-Identifier: Apache-2.0 */
/* The daemon's own pipeline, from the bytes of a frame to an estimate: presets, other decodes,
 * other numbers of lights. */
#include <cmath>
#include <cstring>

#include "contestant.hpp"

extern "C" {
#include "estimate/pipeline.h"
#include "include/frame.h"
#include "include/polarization_grid.h"
}

namespace
{

constexpr float kExposureUs = 10000.0F;	     /* all pictures are of one exposure setting */
constexpr float kBracketStep = 16.0F;	     /* frames.py: EXPOSURE_STEP */
constexpr int64_t kFramePeriodNs = 33333333; /* 30 frames per second */
constexpr int kSettlingFrames = 2;	     /* until nothing of a still picture is new */
constexpr int kAngles = 4;		     /* of a sweep */

void keep(struct lp_frame *)
{
}

struct lp_frame frame_of(const bench::picture &p, int number)
{
	struct lp_frame frame = {};

	frame.format = LP_FORMAT_MJPEG;
	frame.width_px = static_cast<uint32_t>(p.width_px);
	frame.height_px = static_cast<uint32_t>(p.height_px);
	frame.data = p.jpeg.data();
	frame.size_bytes = p.jpeg.size();
	frame.exposure_us = kExposureUs;
	frame.gain = 1.0F;
	frame.wheel_deg = frame.wheel_sigma_deg = NAN;
	for (float &component : frame.orientation)
		component = NAN;
	frame.orientation_sigma_deg = frame.row_time_us = NAN;
	frame.t_read_ns = frame.t_arrival_ns = kFramePeriodNs * (number + 1);
	frame.release = keep;
	return frame;
}

/* The daemon's defaults but for what is named. */
struct lp_pipeline_options defaults(const lp_camera_file &camera)
{
	struct lp_pipeline_options options = {};

	options.cameras[0] = &camera;
	options.preset = LP_PRESET_BALANCED;
	options.max_lights = LP_MAX_LIGHTS;
	options.sh_order = LP_MAX_SH_ORDER;
	options.orientation = LP_ORIENTATION_VISUAL;
	options.smoothing_ms = 200.0F;
	options.ttl_ms = 1000.0F;
	return options;
}

/* A camera that turns: each picture is the next frame. */
struct pipeline : bench::contestant {
	struct lp_pipeline_options options;
	struct lp_pipeline *self = nullptr;
	struct lp_demand demand;
	struct lp_estimates estimates = {};
	int exposures; /* of a bracket that goes round */
	int number = 0;
	bool swept = false; /* behind a film that goes round its angles */

	pipeline(const char *its_name, const struct lp_pipeline_options &its_options, int lights,
		 int its_exposures)
	    : contestant(its_name), options(its_options), demand{LP_MAX_SH_ORDER, lights, 0, false},
	      exposures(its_exposures)
	{
		begin();
	}
	~pipeline() override
	{
		lp_pipeline_destroy(self);
	}
	pipeline(const pipeline &) = delete;
	pipeline &operator=(const pipeline &) = delete;

	/* As a daemon that has just started. */
	void begin()
	{
		lp_pipeline_destroy(self);
		if (lp_pipeline_create(&options, &self) < 0)
			bench::die(name.c_str(), "create");
	}

	void run(const bench::picture &p) override
	{
		const int steps = number % exposures;

		if (steps > static_cast<int>(p.shorter.size()))
			bench::die(name.c_str(), "no shorter exposures beside this picture");
		struct lp_frame frame = frame_of(steps ? p.shorter[steps - 1] : p, number++);
		float command_us;

		frame.gain = std::pow(kBracketStep, static_cast<float>(-steps));
		if (swept) {
			frame.wheel_deg = 180.0F / kAngles * static_cast<float>(number % kAngles);
			frame.wheel_sigma_deg = 0.5F;
		}
		if (lp_pipeline_process(self, &frame, &demand, &estimates, &command_us) < 0)
			bench::die(name.c_str(), "no estimate");
	}

	std::string result() const override
	{
		const struct lp_light_estimate &e = estimates.raw;
		std::string text = "{\"lights\": " + std::to_string(e.light_count) + ", \"sh\": [";

		for (int i = 0; i < LP_MAX_SH_COUNT; i++) {
			char row[100];

			std::snprintf(row, sizeof(row), "%s[%.9g, %.9g, %.9g]", i ? ", " : "",
				      static_cast<double>(e.sh_total[i][0]),
				      static_cast<double>(e.sh_total[i][1]),
				      static_cast<double>(e.sh_total[i][2]));
			text += row;
		}
		return text + "]}";
	}
};

/* A camera that stands: one more frame of a picture that has been seen before. */
struct still_pipeline final : pipeline {
	const bench::picture *seen = nullptr;

	using pipeline::pipeline;
	std::vector<bench::timing> measure(const bench::picture &p) override
	{
		if (seen != &p) {
			seen = &p;
			begin();
			for (int k = 0; k < kSettlingFrames * exposures; k++)
				run(p);
		}
		return pipeline::measure(p);
	}
};

/* A film before the lens that goes round its angles: one frame, one sweep, and the map that clients
 * may ask for. */
struct film_pipeline final : bench::contestant {
	still_pipeline one;
	std::unique_ptr<struct lp_polarization_grid> map =
		std::make_unique<struct lp_polarization_grid>();

	explicit film_pipeline(const struct lp_pipeline_options &options)
	    : contestant("film"), one("film_frame", options, LP_MAX_LIGHTS, 1)
	{
		one.swept = true;
	}
	void run(const bench::picture &p) override
	{
		one.run(p);
	}
	std::vector<bench::timing> measure(const bench::picture &p) override
	{
		int64_t sweep_ns = 0, frame_ns = 0;

		for (int k = 0; k < kAngles; k++) {
			frame_ns = one.measure(p).front().ns;
			sweep_ns += frame_ns;
		}
		const int64_t begin_ns = bench::now_ns();

		if (!lp_pipeline_polarization(one.self, map.get()))
			bench::die(name.c_str(), "no map");
		return {{"film_frame", frame_ns},
			{"film_sweep", sweep_ns},
			{"film_map", bench::now_ns() - begin_ns}};
	}
};

} /* namespace */

void bench::add_pipelines(contestants &list, const lp_camera_file &camera)
{
	const struct {
		const char *name;
		enum lp_preset preset;
		int divisor, lights, exposures;
	} all[] = {
		{"fast", LP_PRESET_FAST, 0, LP_MAX_LIGHTS, 1},
		{"balanced", LP_PRESET_BALANCED, 0, LP_MAX_LIGHTS, 1},
		{"accurate", LP_PRESET_ACCURATE, 0, LP_MAX_LIGHTS, 1},
		{"reference", LP_PRESET_REFERENCE, 0, LP_MAX_LIGHTS, 1},
		{"balanced_decode_1_1", LP_PRESET_BALANCED, 1, LP_MAX_LIGHTS, 1},
		{"balanced_decode_1_2", LP_PRESET_BALANCED, 2, LP_MAX_LIGHTS, 1},
		{"balanced_decode_1_4", LP_PRESET_BALANCED, 4, LP_MAX_LIGHTS, 1},
		{"balanced_decode_1_8", LP_PRESET_BALANCED, 8, LP_MAX_LIGHTS, 1},
		{"lights_0", LP_PRESET_BALANCED, 0, 0, 1},
		{"lights_1", LP_PRESET_BALANCED, 0, 1, 1},
		{"lights_2", LP_PRESET_BALANCED, 0, 2, 1},
		{"lights_4", LP_PRESET_BALANCED, 0, 4, 1},
		{"lights_8", LP_PRESET_BALANCED, 0, 8, 1},
		{"exposures_2", LP_PRESET_BALANCED, 0, LP_MAX_LIGHTS, 2},
		{"exposures_3", LP_PRESET_BALANCED, 0, LP_MAX_LIGHTS, 3},
		{"exposures_4", LP_PRESET_BALANCED, 0, LP_MAX_LIGHTS, 4},
	};

	for (const auto &a : all) {
		struct lp_pipeline_options options = defaults(camera);

		options.preset = a.preset;
		options.decode_divisor = a.divisor;
		list.push_back(
			std::make_unique<still_pipeline>(a.name, options, a.lights, a.exposures));
	}
	struct lp_pipeline_options behind_film = defaults(camera);

	behind_film.film = {0.84F, 500.0F, 1.5F, false, 0.0F, 0.0F};
	list.push_back(std::make_unique<film_pipeline>(behind_film));
	list.push_back(std::make_unique<pipeline>("turning", defaults(camera), LP_MAX_LIGHTS, 1));
}
