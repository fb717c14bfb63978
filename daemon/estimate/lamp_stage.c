/* SPDX-License-Identifier: Apache-2.0 */
#include "estimate/lamp_stage.h"

#include <limits.h>
#include <math.h>
#include <string.h>

#include "include/luminance.h"
#include "include/panorama.h"
#include "light/film/reflection.h"
#include "light/find/detection.h"
#include "light/lamps/holding.h"
#include "light/math/grid.h"
#include "light/math/rotation.h"
#include "light/turn/orientation_track.h"
#include "vision/imager.h"

#define DEG (180.0F / (float)M_PI)
/* What the light was before is a mean with this time constant. */
#define BEFORE_S 1.0F
/* What the wire can say. */
#define LEAST_IRRADIANCE_SIGMA 0.001F
/* Lamps looked at closer beside those that are wanted: they may take their places. */
#define NEXT_LAMPS 2
/* A lamp takes the place of one that is listed when it is so many times as strong. */
#define CLEARLY_STRONGER 1.5F
/* A lamp that detection misses no longer than this still shines where a cell is as bright as this
 * share of its peak. Chosen by hand. */
#define LONGEST_MISS_S 0.3F
#define STILL_THERE 0.5F
/* Of readings through a film while the camera turns: they may miss a part of the lamp. */
#define TURNING_MISFIT 100.0F
/* Likelihood ratio that the film is a quarter turn off, from which on it is said. */
#define TURNED 1e3
/* A lamp that has been listed as a mirror image stays one down to this probability. */
#define STILL_IMAGE 0.5F

static float radius_rad(const struct lp_lamp *lamp)
{
	/* of Omega = 4 pi sin^2(r / 2): exact for tiny ones */
	return 2.0F * asinf(fminf(sqrtf(lamp->solid_angle_sr / (4.0F * (float)M_PI)), 1.0F));
}

/* Pixels know better than cells how strong a small lamp is, near the poles above all. */
static bool enters_by_pixels(const struct lp_detection *detection,
			     const struct lp_lamp_sighting *sighting)
{
	const float on_grid = sighting->on_grid.irradiance[LP_LUMINANCE];
	const float rest = on_grid * (1.0F / fmaxf(sighting->on_grid.share, 1e-6F) - 1.0F);
	const float own = sighting->pixels.irradiance[LP_LUMINANCE];
	struct lp_lamp lamp = sighting->pixels;

	lamp.share = own / (own + rest);
	return lp_detection_enters(detection, &lamp);
}

/* Lamps are looked at in full resolution, the small ones that the grid misplaces above all. */
static void look_closer(const struct lp_lamp_stage *stage, struct lp_imager *imager,
			const struct lp_detection *detection, const struct lp_lamp_stage_work *work,
			int index, bool closer, struct lp_lamp_sighting *sighting)
{
	const struct lp_lamp_memory *memory = &stage->memory;
	const struct lp_lamp_finder *finder = detection->finder;
	struct lp_lamp *pixels = &sighting->pixels;
	/* Near lamps are large, and the map lags behind a probe that goes: as large as can be. */
	const int most_cells = stage->is_placed ? INT_MAX : work->refine_cells;

	sighting->on_grid = *pixels = finder->lamps[index];
	sighting->enters = lp_detection_enters(detection, pixels);
	sighting->width_deg = lp_detection_width_deg(detection, pixels);
	const struct lp_remembered_lamp *known = lp_lamp_memory_find(memory, pixels);
	const bool worth = known ? !known->wide && (known->listed || closer)
				 : closer && sighting->width_deg < LP_COMPACT_DEG;

	sighting->refined =
		worth && work->refine_cells && lp_imager_refine(imager, finder, pixels, most_cells);
	sighting->enters =
		sighting->enters || (sighting->refined && enters_by_pixels(detection, sighting));
	const float noise = pixels->background_noise * pixels->solid_angle_sr /
			    fmaxf(pixels->irradiance[LP_LUMINANCE], 1e-30F);

	sighting->scale = lp_imager_scale(imager);
	const struct lp_film_view *film = lp_imager_film(imager);

	struct lp_imager_status status;

	lp_imager_status(imager, &status);
	sighting->film_misfit = status.rotation_sigma_deg > 0.0F ? TURNING_MISFIT : 1.0F;
	sighting->film_rest_s = film ? film->film->rest_s : 0.0F;
	sighting->film =
		film ? lp_film_pass(film, pixels->direction) : (struct lp_film_pass){.gain = 1.0F};
	const float cells =
		sighting->refined ? 0.0F : lp_imager_cells_sigma(imager, finder, pixels);

	const float own = hypotf(lp_imager_strength_sigma(imager, pixels), noise);

	sighting->strength_sigma =
		fmaxf(hypotf(hypotf(own, cells), sighting->refined ? pixels->cut : 0.0F),
		      LEAST_IRRADIANCE_SIGMA);
}

void lp_lamp_stage_steer(struct lp_lamp_stage *stage, struct lp_imager *imager,
			 const struct lp_detection *detection,
			 const struct lp_lamp_stage_work *work)
{
	struct lp_lamp_sighting sightings[LP_MAX_LIGHTS];
	struct lp_imager_status status;
	double pull[3], information[3][3];
	int count = 0;
	const bool goes = lp_imager_turn(imager).goes;

	lp_imager_status(imager, &status);
	if (!(status.rotation_sigma_deg > 0.0F) || !work->refine_cells)
		return;
	for (int k = 0; k < LP_MAX_LAMPS && count < work->wanted_lights; k++) {
		const struct lp_remembered_lamp *m = &stage->memory.list[k];
		struct lp_lamp_sighting *s = &sightings[count];

		if (!m->id || !m->seen || !m->by_pixels)
			continue;
		/* the way has changed its direction, by how much only its distance tells */
		if (goes && isnan(lp_parallax_distance(&m->parallax).distance_m))
			continue;
		s->pixels = m->on_grid;
		s->refined =
			lp_imager_refine(imager, detection->finder, &s->pixels, work->refine_cells);
		count += s->refined;
	}
	if (lp_lamp_memory_landmarks(&stage->memory, sightings, count,
				     status.rotation_sigma_deg / DEG, pull, information))
		lp_imager_correct_rotation(imager, pull, (const double(*)[3])information);
}

/* Anchor frame to that in which the probe's place is told. */
static struct lp_rotation to_world(const struct lp_imager *imager, const struct lp_rotation *told)
{
	const struct lp_rotation back = lp_rotation_inverse(lp_imager_rotation(imager));

	return lp_rotation_product(told, &back);
}

/* Where the probe is, `before` and now, tells how fast it goes. Returns the way, anchor frame. */
static void find_way(const struct lp_probe_pose *before, struct lp_probe_pose *now, double way_m[3])
{
	const struct lp_rotation to_anchor = lp_rotation_inverse(&now->rotation);
	const double elapsed_s = (double)(now->t_ns - before->t_ns) / 1e9;
	double in_world[3];

	for (int a = 0; a < 3; a++) {
		in_world[a] = now->position_m[a] - before->position_m[a];
		now->velocity_m_s[a] = elapsed_s > 0.0 ? in_world[a] / elapsed_s : 0.0;
	}
	lp_rotate(&to_anchor, in_world, way_m);
}

bool lp_lamp_stage_go(struct lp_lamp_stage *stage, const struct lp_imager *imager, double way_m[3])
{
	const struct lp_imager_told told = lp_imager_told(imager);
	const struct lp_probe_pose before = stage->pose;
	struct lp_probe_pose *now = &stage->pose;

	stage->is_placed = told.known && !told.left_out && told.position_sigma_m > 0.0;
	if (!stage->is_placed)
		return false;
	*now = (struct lp_probe_pose){.t_ns = told.t_ns,
				      .world = before.world,
				      .rotation = to_world(imager, &told.rotation),
				      .sigma_rad = told.own_sigma_rad,
				      .sigma_m = told.position_sigma_m,
				      .late_sigma_s = told.late_sigma_s};
	memcpy(now->position_m, told.position_m, sizeof(now->position_m));
	memcpy(now->rate_rad_s, told.rate_rad_s, sizeof(now->rate_rad_s));
	const double elapsed_s = (double)(now->t_ns - before.t_ns) / 1e9;

	if (!(before.sigma_m > 0.0) || stage->told_by != told.by ||
	    lp_track_jumps(before.position_m, now->position_m, before.sigma_m + now->sigma_m,
			   elapsed_s)) {
		stage->told_by = told.by;
		now->world++;
		return false;
	}
	find_way(&before, now, way_m);
	/* poses err alike for some seconds: of two that follow each other most is the same */
	lp_lamp_memory_go(&stage->memory, way_m,
			  now->sigma_m * sqrt(fmin(2.0 * elapsed_s / LP_POSE_MEMORY_S, 2.0)));
	return true;
}

static float elapsed_s(const struct lp_lamp_stage *stage, int64_t t_capture_ns)
{
	const int64_t elapsed_ns = stage->t_ns ? t_capture_ns - stage->t_ns : 0;

	return elapsed_ns > 0 ? (float)elapsed_ns / 1e9F : 0.0F;
}

void lp_lamp_stage_hold(struct lp_lamp_stage *stage, struct lp_detection *detection,
			const struct lp_panorama *panorama, float mean)
{
	lp_hold_lamps(&stage->memory, detection, panorama, mean,
		      elapsed_s(stage, panorama->t_capture_ns));
}

/* All remembered lamps, strongest first; returns how many. */
static int all_lamps(struct lp_lamp_stage *stage, struct lp_remembered_lamp *list[LP_MAX_LAMPS])
{
	int count = 0;

	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		struct lp_remembered_lamp *m = &stage->memory.list[k];
		int at = count;

		if (!m->id)
			continue;
		for (; at > 0 && list[at - 1]->lamp.irradiance[LP_LUMINANCE] <
					 m->lamp.irradiance[LP_LUMINANCE];
		     at--)
			list[at] = list[at - 1];
		list[at] = m;
		count++;
	}
	return count;
}

/* By the lamp's own pixels; of one too large for these, by its cells. */
static void measure_polarization(struct lp_remembered_lamp *m, const struct lp_imager *imager,
				 const struct lp_lamp_finder *finder)
{
	m->polarization = lp_stokes_polarization(&m->stokes);
	if (!m->polarization.known && m->seen)
		m->polarization = lp_imager_polarization(imager, finder, &m->on_grid);
}

/* Once: where the film is edge-on, no sweep tells it. */
static void count_unmeasured(struct lp_lamp_stage *stage, struct lp_remembered_lamp *m)
{
	if (m->counted)
		return;
	stage->unmeasured += !m->polarization.known;
	m->counted = true;
}

/* By the lamps' images; or by all of the floor, if those do not contradict. */
static bool film_is_turned(const struct lp_suspect *suspects, int count,
			   const struct lp_imager *imager)
{
	const double evidence = lp_film_turned_evidence(suspects, count);

	return evidence > TURNED ||
	       (evidence > 1.0 / TURNED && lp_imager_film_seems_turned(imager));
}

/* Which of the remembered lamps are mirror images of others. */
static void tell_reflections(struct lp_lamp_stage *stage, const struct lp_imager *imager,
			     const struct lp_lamp_finder *finder)
{
	struct lp_remembered_lamp *lamps[LP_MAX_LAMPS];
	struct lp_suspect suspects[LP_MAX_LAMPS];
	struct lp_verdict verdicts[LP_MAX_LAMPS];
	const int count = all_lamps(stage, lamps);

	for (int k = 0; k < count; k++) {
		const struct lp_lamp *lamp = &lamps[k]->lamp;

		measure_polarization(lamps[k], imager, finder);
		count_unmeasured(stage, lamps[k]);
		suspects[k] = (struct lp_suspect){.irradiance = lamp->irradiance[LP_LUMINANCE],
						  .is_bound = lamp->flags & LP_LIGHT_CLIPPED,
						  .radius_deg = radius_rad(lamp) * DEG,
						  .polarization = lamps[k]->polarization};
		memcpy(suspects[k].direction, lamp->direction, sizeof(lamp->direction));
	}
	stage->film_is_turned = film_is_turned(suspects, count, imager);
	/* Then all angles of polarization are wrong, and place and strength are left. */
	for (int k = 0; stage->film_is_turned && k < count; k++)
		lamps[k]->polarization.known = suspects[k].polarization.known = false;
	lp_tell_reflections(suspects, count, verdicts);
	for (int k = 0; k < count; k++) {
		lamps[k]->image_probability = verdicts[k].reflection;
		lamps[k]->reflection =
			verdicts[k].kind == LP_CLASS_REFLECTION ||
			(lamps[k]->reflection && verdicts[k].reflection > STILL_IMAGE);
	}
}

/* Share of a lamp's light that has come to its own cells; 0 where nothing was known of them. */
static float share_that_came(const struct lp_lamp_stage *stage, const struct lp_lamp_finder *finder,
			     const struct lp_panorama *panorama, const struct lp_lamp *lamp)
{
	float came = 0.0F;

	for (int i = 0; i < lamp->count && stage->has_before; i++) {
		const int cell = finder->cells[lamp->first + i];

		came += (panorama->cells[cell][LP_LUMINANCE] - stage->before[cell]) *
			lp_grid_solid_angle_sr(finder->grid, cell);
	}
	return came / fmaxf(lamp->irradiance[LP_LUMINANCE], 1e-30F);
}

static void remember_light(struct lp_lamp_stage *stage, const struct lp_grid *grid,
			   const struct lp_panorama *panorama, float elapsed_s)
{
	const float alpha = stage->has_before ? -expm1f(-elapsed_s / BEFORE_S) : 1.0F;

	for (int cell = 0; cell < grid->width * grid->height; cell++)
		stage->before[cell] +=
			alpha * (panorama->cells[cell][LP_LUMINANCE] - stage->before[cell]);
	stage->has_before = true;
}

void lp_lamp_stage_update(struct lp_lamp_stage *stage, struct lp_imager *imager,
			  const struct lp_detection *detection,
			  const struct lp_lamp_stage_work *work, const struct lp_panorama *panorama)
{
	const struct lp_lamp_finder *finder = detection->finder;
	struct lp_lamp_sighting sightings[LP_MAX_LAMPS];
	struct lp_imager_status status;
	int small = 0;

	lp_imager_status(imager, &status);
	for (int k = 0; k < finder->count; k++) {
		look_closer(stage, imager, detection, work, k,
			    small < work->wanted_lights + NEXT_LAMPS, &sightings[k]);
		sightings[k].came = share_that_came(stage, finder, panorama, &sightings[k].on_grid);
		small += sightings[k].width_deg < LP_COMPACT_DEG;
	}
	const struct lp_imager_told told = lp_imager_told(imager);

	stage->pose.rotation = to_world(imager, &told.rotation); /* by what the frame showed, too */
	const struct lp_memory_times times = {.elapsed_s = elapsed_s(stage, panorama->t_capture_ns),
					      .rotation_sigma_rad = status.rotation_sigma_deg / DEG,
					      .pose = stage->is_placed ? &stage->pose : NULL};

	lp_lamp_memory_update(&stage->memory, sightings, finder->count, &times);
	remember_light(stage, finder->grid, panorama, times.elapsed_s);
	stage->t_ns = panorama->t_capture_ns;
	if (work->has_film)
		tell_reflections(stage, imager, finder);
}

void lp_lamp_stage_turn(struct lp_lamp_stage *stage, const struct lp_rotation *turn)
{
	lp_lamp_memory_turn(&stage->memory, turn);
	stage->has_before = false; /* its cells lie elsewhere now */
}

static bool is_bright(const struct lp_grid *grid, const struct lp_panorama *panorama,
		      const struct lp_remembered_lamp *m)
{
	const int cell = lp_grid_cell(grid, m->on_grid.direction);

	return panorama->cells[cell][LP_LUMINANCE] > STILL_THERE * m->on_grid.peak;
}

/* Where the panorama still shows a lamp's light, another sighting has it, or detection misses a
 * lamp that is on its threshold: nothing is hidden. */
static void find_hidden(struct lp_lamp_stage *stage, const struct lp_grid *grid,
			const struct lp_panorama *panorama)
{
	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		struct lp_remembered_lamp *m = &stage->memory.list[k];

		m->missed = m->missed && !is_bright(grid, panorama, m);
	}
}

static bool shines(const struct lp_grid *grid, const struct lp_panorama *panorama,
		   const struct lp_remembered_lamp *m)
{
	return m->seen || lp_lamp_may_be_hidden(m) ||
	       (m->absent_s < LONGEST_MISS_S && is_bright(grid, panorama, m));
}

static float strength(const struct lp_remembered_lamp *m)
{
	const float seen = m->lamp.irradiance[LP_LUMINANCE];

	return m->recovered_sigma > 0.0F ? seen + m->recovered[LP_LUMINANCE]
					 : seen * (1.0F + m->hidden);
}

/* Lamps before area lights, each strongest first. */
static bool precedes(const struct lp_remembered_lamp *a, const struct lp_remembered_lamp *b)
{
	return a->wide != b->wide ? b->wide : strength(a) > strength(b);
}

/* The same, while those that have been listed before keep their places. */
static bool keeps_its_place(const struct lp_remembered_lamp *a, const struct lp_remembered_lamp *b)
{
	return a->wide != b->wide ? b->wide
				  : strength(a) * (a->listed ? CLEARLY_STRONGER : 1.0F) >
					    strength(b) * (b->listed ? CLEARLY_STRONGER : 1.0F);
}

static void insert(struct lp_remembered_lamp *list[], int count, struct lp_remembered_lamp *m,
		   bool (*before)(const struct lp_remembered_lamp *,
				  const struct lp_remembered_lamp *))
{
	int at = count;

	for (; at > 0 && before(m, list[at - 1]); at--)
		list[at] = list[at - 1];
	list[at] = m;
}

/* Those to be listed, in their order; returns how many. Of those that are as strong, but may be no
 * lamps, is noted that they are listed, too: they are looked at closer, and their light tells how
 * the camera turns. *lamps: how many lamps there are in all. */
static int choose(struct lp_lamp_stage *stage, const struct lp_grid *grid,
		  const struct lp_panorama *panorama, int most,
		  struct lp_remembered_lamp *chosen[LP_MAX_LIGHTS], int *lamps)
{
	struct lp_remembered_lamp *all[LP_MAX_LAMPS];
	int places = 0, count = 0;

	*lamps = 0;
	for (int k = 0; k < LP_MAX_LAMPS; k++) {
		struct lp_remembered_lamp *m = &stage->memory.list[k];

		if (!m->id || !shines(grid, panorama, m))
			continue;
		insert(all, places++, m, keeps_its_place);
		*lamps += lp_exists(&m->existence) && !m->wide;
	}
	for (int k = 0; k < LP_MAX_LAMPS; k++)
		stage->memory.list[k].listed = false;
	for (int k = 0; k < places && (k < most || count < most); k++) {
		const bool is_chosen = count < most && lp_exists(&all[k]->existence);

		all[k]->listed = k < most || is_chosen;
		if (is_chosen)
			insert(chosen, count++, all[k], precedes);
	}
	return count;
}

/* Relative. A lower bound has none, unless the ring says what lies above it. */
static float strength_sigma(const struct lp_remembered_lamp *m)
{
	if (m->recovered_sigma > 0.0F)
		return fmaxf(m->recovered_sigma / strength(m), LEAST_IRRADIANCE_SIGMA);
	return m->lamp.flags & LP_LIGHT_CLIPPED
		       ? NAN
		       : fmaxf(sqrtf(m->strength_variance), LEAST_IRRADIANCE_SIGMA);
}

static struct lp_light_polarization polarization_of(const struct lp_remembered_lamp *m)
{
	const struct lp_polarization p = m->polarization;

	return (struct lp_light_polarization){.judged = !isnan(m->image_probability),
					      .known = p.known,
					      .reflection = m->image_probability,
					      .dolp = p.dolp,
					      .aolp_deg = p.aolp_deg,
					      .dolp_sigma = p.dolp_sigma,
					      .aolp_sigma_deg = p.aolp_sigma_deg};
}

static void list_light(const struct lp_remembered_lamp *m, bool is_placed, struct lp_light *light)
{
	const struct lp_lamp *lamp = &m->lamp;
	const bool by_ring = m->recovered_sigma > 0.0F;
	const struct lp_lamp_distance distance =
		is_placed ? lp_parallax_distance(&m->parallax)
			  : (struct lp_lamp_distance){NAN, NAN, 0.0F};

	*light = (struct lp_light){/* all of it: what is not named is zero */
				   .id = m->id,
				   .angular_radius_deg = radius_rad(lamp) * DEG,
				   .direction_sigma_deg = lamp->direction_sigma_deg,
				   .irradiance_sigma = strength_sigma(m),
				   .colour_sigma =
					   by_ring ? m->recovered_colour_sigma / strength(m) : 0.0F,
				   .distance_m = distance.distance_m,
				   .distance_sigma = distance.sigma,
				   .nearest_m = distance.nearest_m,
				   .hidden = m->hidden,
				   .flags = lamp->flags | (m->seen ? 0 : LP_LIGHT_HELD) |
					    (m->wide ? LP_LIGHT_EXTENDED : 0) |
					    (by_ring ? LP_LIGHT_RING : 0) |
					    (m->reflection ? LP_LIGHT_REFLECTION : 0),
				   .polarization = polarization_of(m)};
	memcpy(light->direction, lamp->direction, sizeof(light->direction));
	for (int c = 0; c < 3; c++)
		light->irradiance[c] = lamp->irradiance[c] + m->recovered[c];
	if (m->wide) {
		memcpy(light->half_angle_deg, lamp->half_angle_deg, sizeof(light->half_angle_deg));
		memcpy(light->axis, lamp->axis, sizeof(light->axis));
	}
}

int lp_lamp_stage_list(struct lp_lamp_stage *stage, const struct lp_grid *grid,
		       const struct lp_panorama *panorama, int most,
		       struct lp_light_estimate *estimate)
{
	const bool is_placed = stage->is_placed && !lp_lamp_memory_doubts_places(&stage->memory);
	struct lp_remembered_lamp *chosen[LP_MAX_LIGHTS];
	int lamps;

	find_hidden(stage, grid, panorama);
	estimate->unmeasured = stage->unmeasured;
	estimate->light_count = choose(stage, grid, panorama, most, chosen, &lamps);
	estimate->area_count = lamps < estimate->light_count ? estimate->light_count - lamps : 0;
	for (int k = 0; k < estimate->light_count; k++)
		list_light(chosen[k], is_placed, &estimate->lights[k]);
	return lamps;
}
