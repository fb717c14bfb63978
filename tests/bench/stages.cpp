/* SPDX-License-Identifier: Apache-2.0 */
/* Where the time of a preset goes: its stages by the same calls that estimate/pipeline.c makes. */
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "contestant.hpp"
#include "vision/camera/camera.h"
#include "vision/camera/camera_file.h"
#include "vision/camera/remap.h"
#include "vision/imager.h"
#include "vision/imager_internal.h"
#include "vision/jpeg/blocks.h"
#include "vision/map/cube_sample.h"
#include "vision/map/sh_project.h"
#include "vision/picture/cells.h"

extern "C" {
#include "include/frame.h"
#include "include/luminance.h"
#include "include/panorama.h"
#include "light/clipped/ring_fusion.h"
#include "light/find/detection.h"
#include "light/send/tracker.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "light/send/cube.h"
#include "light/send/model.h"
}

namespace
{

constexpr int kExactBlocks = 16, kRefineCells = 49; /* `balanced`, estimate/pipeline.c */
constexpr float kScale = 100.0F;		    /* 10 ms */

/* A reflection map of one size, and what it is sent as. */
struct reflection {
	struct lp_cube_grid *grid = nullptr;
	struct lp_cube cube = {};
	std::vector<uint8_t> texels;

	explicit reflection(int size)
	{
		if (lp_cube_grid_create(size, &grid) < 0)
			bench::die("stages", "reflection map");
		cube.grid = grid;
		for (float *&plane : cube.rgb)
			plane = static_cast<float *>(
				std::aligned_alloc(16, static_cast<size_t>(grid->texels) *
							       sizeof(float)));
		texels.resize(4 * static_cast<size_t>(grid->texels));
	}
	~reflection()
	{
		for (float *plane : cube.rgb)
			std::free(plane);
		lp_cube_grid_destroy(grid);
	}
	reflection(const reflection &) = delete;
	reflection &operator=(const reflection &) = delete;
};

/* Stages of `balanced`, one after the other. */
struct stages final : bench::contestant {
	struct lp_camera *camera = nullptr;
	struct lp_imager *imager = nullptr;
	struct lp_detection *detection = nullptr;
	struct lp_sh_projector *projector = nullptr;
	struct lp_jpeg_reader *reader = nullptr;
	struct lp_response response = {};
	struct lp_cells cells = {};
	struct lp_tracker tracker = {};
	struct reflection reflections[3] = {reflection(16), reflection(32), reflection(64)};
	struct lp_clipped_parts no_parts = {};
	std::vector<bench::timing> times;
	int64_t last_ns = 0;

	explicit stages(const lp_camera_file &file);
	~stages() override;
	stages(const stages &) = delete;
	stages &operator=(const stages &) = delete;

	void lap(const std::string &stage)
	{
		times.push_back({"stage_" + stage, bench::now_ns() - last_ns});
		last_ns = bench::now_ns();
	}
	void fuse_ring(const struct lp_panorama &panorama);
	void make_reflection_map(struct reflection &map, const struct lp_panorama &panorama,
				 const double (*sh)[3]);
	void run(const bench::picture &p) override;
	std::vector<bench::timing> measure(const bench::picture &p) override
	{
		run(p);
		return times;
	}
};

stages::stages(const lp_camera_file &file) : contestant("stages")
{
	struct lp_imager_options options = {};
	const struct lp_detector_options detector = {};

	options.panorama_width = LP_PANORAMA_WIDTH;
	options.decode = LP_DECODE_BLOCKS;
	options.divisor = 1;
	options.exact_blocks = kExactBlocks;
	if (lp_camera_create(&file, &camera) < 0 ||
	    lp_imager_create(camera, &options, &imager) < 0 ||
	    lp_detection_create(lp_imager_grid(imager), &detector, &detection) < 0 ||
	    lp_sh_projector_create(LP_PANORAMA_WIDTH, LP_PANORAMA_WIDTH / 2, LP_SH_MAX_ORDER,
				   &projector) < 0 ||
	    lp_jpeg_reader_create(&reader) < 0)
		bench::die("stages", "create");
	lp_response_init(&response, camera);
	tracker.time_constant_ms = 200.0F;
}

stages::~stages()
{
	lp_cells_release(&cells);
	lp_jpeg_reader_destroy(reader);
	lp_sh_projector_destroy(projector);
	lp_detection_destroy(detection);
	lp_imager_destroy(imager);
	lp_camera_destroy(camera);
}

/* What the ring costs: so many clipped parts, all around, and as much light hidden in each as is
 * seen of all. Made up, but for what the panorama shows. */
void look_at_ring(const struct lp_ring_sample &sample, int count, struct lp_ring_view &view)
{
	view.count = count;
	view.seen_sigma = 0.01F;
	for (int j = 0; j < view.count; j++) {
		const double height = (2.0 * j + 1.0) / view.count - 1.0, around = 2.4 * j;
		const double wide = std::sqrt(1.0 - height * height);

		view.parts[j].bound = 0.01F;
		for (int k = 0; k < LP_RING_SENSORS; k++) {
			float n[3];

			lp_ring_looks_along(&sample, k, n);
			view.parts[j].weight[k] = static_cast<float>(
				std::max(wide * std::cos(around) * n[0] + height * n[1] +
						 wide * std::sin(around) * n[2],
					 0.0));
		}
	}
}

void stages::fuse_ring(const struct lp_panorama &panorama)
{
	const struct lp_rotation straight = lp_rotation_identity();
	const struct lp_ring_scale known = {100.0F, 0.02F};
	struct lp_ring_sample sample = {};
	struct lp_ring_view view = {};
	struct lp_ring_past past = {};
	struct lp_ring_fusion fusion = {};

	no_parts.grid = lp_imager_grid(imager);
	lp_ring_view_init(&view, no_parts.grid, &panorama, &no_parts, &straight, &sample,
			  LP_LUMINANCE);
	lap("ring_view");
	for (const int count : {1, 4, 8, LP_MAX_CLIPPED_PARTS}) {
		look_at_ring(sample, count, view);
		for (int k = 0; k < LP_RING_SENSORS; k++) {
			float lux = view.seen[k];

			for (int j = 0; j < view.count; j++)
				lux += view.parts[j].weight[k] * view.seen[j % LP_RING_SENSORS];
			sample.illuminance_lux[k] = known.lux_per_unit * lux;
			sample.sigma_relative[k] = 0.03F;
		}
		last_ns = bench::now_ns();
		lp_ring_fuse(&view, &sample, NULL, &known, &fusion);
		lap("ring_fusion_" + std::to_string(count) + "_parts");
		past.count = LP_RING_POSES;
		for (auto &look : past.list)
			look = {view, sample, 1.0F};
		lp_ring_fuse(&view, &sample, &past, &known, &fusion);
		lap("ring_fusion_" + std::to_string(count) + "_parts_turning");
	}
}

void keep(struct lp_frame *)
{
}

/* On request: the cube, its lamps and fit, as estimate/surroundings.c and serve/reflection_maps.c
 * make it.
 */
void stages::make_reflection_map(struct reflection &map, const struct lp_panorama &panorama,
				 const double (*sh)[3])
{
	const struct lp_rotation straight = lp_rotation_identity();

	lp_cube_sample(lp_imager_grid(imager), panorama.cells, &straight, map.grid->size,
		       map.cube.rgb);
	lp_cube_fit(&map.cube, sh);
	for (int k = 0; k < detection->finder->count && k < LP_MAX_LIGHTS; k++) {
		const struct lp_lamp &lamp = detection->finder->lamps[k];
		struct lp_light light = {};

		std::copy_n(lamp.direction, 3, light.direction);
		light.angular_radius_deg = lamp.half_angle_deg[1];
		lp_cube_add_light(&map.cube, &light, lamp.irradiance);
	}
	lp_cube_encode(&map.cube, map.texels.data());
}

void stages::run(const bench::picture &p)
{
	struct lp_frame frame = {};
	double total[LP_SH_MAX_COUNT][3];
	struct lp_light_estimate raw = {}, smoothed;

	frame.format = LP_FORMAT_MJPEG;
	frame.width_px = static_cast<uint32_t>(p.width_px);
	frame.height_px = static_cast<uint32_t>(p.height_px);
	frame.data = p.jpeg.data();
	frame.size_bytes = p.jpeg.size();
	frame.exposure_us = 1e6F / kScale;
	frame.gain = 1.0F;
	frame.release = keep;
	/* untimed: the imager's own pass, so that the stages after it have their panorama */
	if (lp_imager_add(imager, &frame) < 0)
		bench::die("stages", "imager");
	times.clear();
	last_ns = bench::now_ns();
	if (lp_jpeg_read(reader, p.jpeg.data(), p.jpeg.size()) < 0)
		bench::die("stages", "reader");
	lap("reader");
	lp_cells_from_jpeg(&cells, reader, 8, imager->eye->row_weight, imager->eye->remap->seen,
			   &response, kScale, 0);
	lap("cells");
	lp_cells_from_jpeg(&cells, reader, 8, imager->eye->row_weight, imager->eye->remap->seen,
			   &response, kScale, kExactBlocks);
	const int64_t with_exact_ns = bench::now_ns() - last_ns;
	times.push_back({"stage_exact_blocks", with_exact_ns - times.back().ns});
	last_ns = bench::now_ns();
	lp_remap_apply(imager->eye->remap, &imager->eye->incoming.cells, &imager->eye->seen);
	lap("panorama");
	struct lp_observation seen = {};

	seen.radiance = imager->eye->seen.cells;
	seen.flags = imager->eye->seen.flags;
	seen.response = &response;
	seen.scale = kScale;
	seen.coded = true;
	seen.code_variance = 1.0F;
	seen.elapsed_s = 0.033F;
	lp_radiance_map_observe(imager->map, &seen);
	lap("map");
	const struct lp_panorama *panorama = lp_imager_panorama(imager);
	const float mean = lp_grid_mean_luminance(lp_imager_grid(imager), panorama);
	lap("mean");
	lp_detect(detection, panorama, mean);
	lap("detection");
	lp_sh_project(projector, panorama, LP_SH_MAX_ORDER, total);
	lap("projection");
	struct lp_lamp_finder *finder = detection->finder;
	for (int k = 0; k < finder->count && k < LP_MAX_LIGHTS; k++) {
		struct lp_lamp lamp = finder->lamps[k];

		lp_imager_refine(imager, finder, &lamp, kRefineCells);
	}
	lap("refinement");
	lp_model_predict(total, &raw);
	lp_tracker_update(&tracker, &raw, &smoothed);
	lap("model_and_tracker");
	fuse_ring(*panorama);
	last_ns = bench::now_ns();
	for (struct reflection &map : reflections) {
		make_reflection_map(map, *panorama, total);
		lap("reflection_map_" + std::to_string(map.grid->size));
	}
}

} /* namespace */

void bench::add_stages(contestants &list, const lp_camera_file &camera)
{
	list.push_back(std::make_unique<stages>(camera));
}
