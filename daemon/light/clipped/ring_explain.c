/* SPDX-License-Identifier: Apache-2.0 */
#include "light/clipped/ring_explain.h"

#include <math.h>
#include <string.h>

/* Chosen by hand (docs/maintainers/constants.md). Squared sigmas: -2 log of how likely it is. */

/* A sensor that is wrong: one in a hundred, with a reading that may be anything. */
#define COST_SENSOR 16.0
/* A hand that is before one sensor covers its neighbours, too: each for so much more. */
#define COST_NEIGHBOUR 3.0
/* A scale other than the one given: about one calibration in three, of another camera, of sensors
 * that have aged or not settled. Only so does the sigma hold where light could hide instead. */
#define COST_SCALE 2.0
/* A ring mounted in a wrong place: about one in thirty for each place. */
#define COST_TURNED 7.0
/* Such a scale is off by this, 1 sigma, relative. */
#define OTHER_SCALE_SIGMA 0.3F
/* The cosine of a part to the sensor that sees it best, below which the ring does not see it: it
 * could hide any light, and light all sensors alike; and a seat that is off by a few degrees would
 * decide how much. */
#define LEAST_COSINE 0.2F
/* Of readings that are explained better than this no sensor is left out. */
#define EXPLAINED 9.0
#define MOST_WRONG 3

static int bits(uint32_t mask)
{
	return __builtin_popcount(mask);
}

/* The eight sensors around the equator, as they would read if the ring were turned to the right by
 * so many of their places. */
static void turn(const struct lp_ring_sample *sample, int places, struct lp_ring_sample *turned)
{
	const int around = LP_RING_SENSORS - 1;

	*turned = *sample;
	for (int k = 0; k < around; k++) {
		turned->illuminance_lux[(k + places) % around] = sample->illuminance_lux[k];
		turned->sigma_relative[(k + places) % around] = sample->sigma_relative[k];
		turned->noise_relative[(k + places) % around] = sample->noise_relative[k];
	}
}

static uint32_t turn_bits(uint32_t mask, int places)
{
	const uint32_t around = mask & 0xFFU;

	return (mask & ~0xFFU) | ((around << places | around >> (8 - places)) & 0xFFU);
}

/* So many sensors around the equator from the first one on. */
static uint32_t neighbours(int first, int count)
{
	return turn_bits((1U << count) - 1U, first);
}

static bool sees(const struct lp_ring_part *part, uint32_t used)
{
	float most = 0.0F;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (used >> k & 1)
			most = fmaxf(most, part->weight[k]);
	return most >= LEAST_COSINE;
}

bool lp_ring_sees(const struct lp_ring_view *view, const struct lp_ring_past *past, int j,
		  uint32_t used)
{
	bool any = sees(&view->parts[j], used);

	for (int p = 0; past && p < past->count; p++)
		any |= sees(&past->list[p].view.parts[j], used);
	return any;
}

static void hide(struct lp_ring_view *view, int j)
{
	memset(view->parts[j].weight, 0, sizeof(view->parts[j].weight));
	memset(view->parts[j].spread, 0, sizeof(view->parts[j].spread));
}

void lp_ring_case_init(struct lp_ring_case *self, const struct lp_ring_problem *problem,
		       const struct lp_ring_explanation *explanation)
{
	turn(problem->sample, explanation->places, &self->sample);
	self->view = *problem->view;
	self->past.count = problem->past ? problem->past->count : 0;
	for (int p = 0; p < self->past.count; p++) {
		self->past.list[p] = problem->past->list[p];
		turn(&problem->past->list[p].sample, explanation->places,
		     &self->past.list[p].sample);
	}
	for (int j = 0; j < self->view.count; j++) {
		if (lp_ring_sees(&self->view, &self->past, j, explanation->used))
			continue;
		hide(&self->view, j);
		for (int p = 0; p < self->past.count; p++)
			hide(&self->past.list[p].view, j);
	}
	self->problem =
		(struct lp_ring_problem){&self->view, &self->sample, &self->past, problem->scale};
	if (explanation->other_scale)
		self->problem.scale.sigma = OTHER_SCALE_SIGMA;
}

/* A scale that may be anything within OTHER_SCALE_SIGMA explains the more, the closer the readings
 * tell it: the evidence counts how much of what was possible is left (MacKay 2003, chapter 28). */
static double cost_of_scale(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit)
{
	const double given = problem->scale.lux_per_unit;
	const double found = sqrt(fit->scale_variance) / given;
	const double left = fmax(found, (double)problem->scale.sigma);

	return COST_SCALE + 2.0 * log(fmax((double)OTHER_SCALE_SIGMA / left, 1.0));
}

/* Sensors that are wrong each by itself, or neighbours around the equator. */
static double cost_of_sensors(uint32_t wrong)
{
	double cost = COST_SENSOR * bits(wrong);

	for (int count = 2; count <= MOST_WRONG; count++)
		for (int first = 0; first < LP_RING_SENSORS - 1; first++)
			if (wrong == neighbours(first, count))
				cost = COST_SENSOR + COST_NEIGHBOUR * (count - 1);
	return cost;
}

static struct lp_ring_explanation explanation_of(const struct lp_ring_problem *problem,
						 uint32_t all, uint32_t used, int places,
						 bool other_scale)
{
	struct lp_ring_explanation e = {.used = used, .places = places, .other_scale = other_scale};
	struct lp_ring_case as_explained;
	struct lp_ring_fit fit;

	lp_ring_case_init(&as_explained, problem, &e);
	lp_ring_fit(&as_explained.problem, used, &fit);
	e.chi2 = fit.chi2;
	e.misfit_now = fit.misfit_now;
	e.freedom = fit.freedom;
	e.price = fit.price;
	e.cost = fit.chi2 + cost_of_sensors(all & ~used);
	if (other_scale)
		e.cost += cost_of_scale(problem, &fit);
	if (places)
		e.cost += COST_TURNED;
	return e;
}

/* Without each of the sensors that count so far; returns how many explanations that are. */
static int leave_one_out(const struct lp_ring_problem *problem, uint32_t all, uint32_t used,
			 bool other_scale, struct lp_ring_explanation *list)
{
	int count = 0;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (used >> k & 1)
			list[count++] =
				explanation_of(problem, all, used & ~(1U << k), 0, other_scale);
	return count;
}

static int leave_neighbours_out(const struct lp_ring_problem *problem, uint32_t all,
				bool other_scale, struct lp_ring_explanation *list)
{
	int found = 0;

	for (int count = 2; count <= MOST_WRONG; count++)
		for (int first = 0; first < LP_RING_SENSORS - 1; first++) {
			const uint32_t used = all & ~neighbours(first, count);

			if (bits(used) == bits(all) - count && bits(used) >= LP_RING_LEAST_USED)
				list[found++] = explanation_of(problem, all, used, 0, other_scale);
		}
	return found;
}

/* All sensors; and where those are not enough, without neighbours, and without the one that the
 * others contradict most, again and again, as long as it is worth it. Returns how many. */
static int leave_out(const struct lp_ring_problem *problem, uint32_t all, bool other_scale,
		     struct lp_ring_explanation *list)
{
	struct lp_ring_explanation best = explanation_of(problem, all, all, 0, other_scale);
	int count = 1;

	list[0] = best;
	if (best.chi2 >= EXPLAINED)
		count += leave_neighbours_out(problem, all, other_scale, list + count);
	for (int wrong = 1; wrong <= MOST_WRONG; wrong++) {
		const double before = best.cost;
		const int from = count;

		if (best.chi2 < EXPLAINED || bits(best.used) <= LP_RING_LEAST_USED)
			break;
		count += leave_one_out(problem, all, best.used, other_scale, list + count);
		best = list[from];
		for (int i = from + 1; i < count; i++)
			if (list[i].cost < best.cost)
				best = list[i];
		if (best.cost >= before)
			break;
	}
	return count;
}

int lp_ring_explain(const struct lp_ring_problem *problem, uint32_t all,
		    struct lp_ring_explanation list[LP_RING_EXPLANATIONS])
{
	int count = leave_out(problem, all, false, list);

	if (problem->scale.sigma < OTHER_SCALE_SIGMA) /* false for NAN */
		count += leave_out(problem, all, true, list + count);
	for (int places = 1; places < LP_RING_SENSORS - 1; places++) {
		const uint32_t turned = turn_bits(all, places);

		list[count++] = explanation_of(problem, turned, turned, places, false);
	}
	return count;
}
