/* SPDX-License-Identifier: Apache-2.0 */
#include "light/clipped/ring_fusion.h"

#include <math.h>
#include <string.h>

#include "light/clipped/ring_explain.h"
#include "light/clipped/ring_posterior.h"
#include "light/clipped/ring_residuals.h"
#include "light/linear/nnls.h"

/* Chosen by hand, on the scenes of docs/users/accuracy.md, "With the ring of light sensors". */

/* Squared sigmas that a fit must gain to be worth any hidden light at all, and all of it. */
#define WORTH_LITTLE 1.5
#define WORTH_LIGHT 4.0
/* Squared sigmas per degree of freedom, and altogether, beyond which the ring is not believed. */
#define MOST_MISFIT 4.0
#define ALWAYS_ALLOWED 9.0
/* Of what hidden light costs in a fit, where each part is a surprise of its own, this share counts
 * where explanations are compared. */
#define PRICE 0.5
/* Explanations less likely than this are left out. */
#define LEAST_WEIGHT 0.01
/* What is wrong is named when all other explanations together are less likely than this. */
#define DOUBT 0.05
/* A part is taken to have been seen with at least this share of the mean light on the sensors. */
#define LEAST_SEEN 1e-3F
/* Of a scale of which nothing is known, no smaller ones than this factor count. */
#define WIDEST 3.0
/* Squared sigmas by which readings of before may make the newest one worse understood; else the
 * light is not the same. */
#define CHANGED 16.0

static int bits(uint32_t mask)
{
	return __builtin_popcount(mask);
}

static uint32_t usable(const struct lp_ring_sample *sample)
{
	uint32_t mask = 0;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		if (lp_ring_tells(sample, k))
			mask |= 1U << k;
	return mask;
}

/* Of a part that clips in hardly any cell next to nothing was seen; it hides light all the same. */
static void raise_bounds(struct lp_ring_view *view)
{
	float mean = 0.0F;

	for (int k = 0; k < LP_RING_SENSORS; k++)
		mean += view->seen[k] / LP_RING_SENSORS;
	for (int j = 0; j < view->count; j++)
		view->parts[j].bound = fmaxf(view->parts[j].bound, LEAST_SEEN * mean);
}

/* How many squared sigmas the readings are worse understood without any hidden light. */
static double evidence(const struct lp_ring_problem *problem, const struct lp_ring_fit *fit)
{
	struct lp_ring_view view = *problem->view;
	struct lp_ring_past past = {0};
	struct lp_ring_problem plain = *problem;
	struct lp_ring_fit without;

	view.count = 0;
	if (problem->past)
		past = *problem->past;
	for (int p = 0; p < past.count; p++)
		past.list[p].view.count = 0;
	plain.view = &view;
	plain.past = &past;
	lp_ring_fit(&plain, fit->used, &without);
	return without.chi2 - fit->chi2;
}

/* Several unknowns explain noise together, and hide light at the wrong place: they count as far as
 * the evidence for them goes (after James & Stein 1961: of p unknowns that explain chi2, the share
 * 1 - p / chi2). So does one alone, up to WORTH_LIGHT. What stays of a sensor's error adds to
 * the evidence in every look, so that n looks count as sqrt(n) of them. */
static double share_that_counts(const struct lp_ring_problem *problem,
				const struct lp_ring_fit *fit)
{
	const int looks = 1 + (problem->past ? problem->past->count : 0);
	const double gain = evidence(problem, fit) / sqrt(looks);
	const double worth =
		fmin(fmax((gain - WORTH_LITTLE) / (WORTH_LIGHT - WORTH_LITTLE), 0.0), 1.0);
	int unknowns = 0;

	for (int j = 0; j < problem->view->count; j++)
		unknowns += fit->x[j + 1] > 0.0;
	return worth * (unknowns > 1 ? fmax(1.0 - unknowns / gain, 0.0) : 1.0);
}

/* Sums over explanations. */
struct mixture {
	double weight, scale, scale2;
	double excess[LP_MAX_CLIPPED_PARTS];
	double square[LP_MAX_CLIPPED_PARTS][LP_MAX_CLIPPED_PARTS];
};

/* What one explanation says of part i: what agrees best with the readings, how far the mean of all
 * that agrees lies from it, and what of it is held back. */
struct finding {
	double excess, off, held;
};

/* `inflation`: of variances. In darkness nothing is added. */
static void add(const struct lp_ring_problem *problem, uint32_t used, double weight,
		double inflation, struct mixture *mixture)
{
	struct finding found[LP_MAX_CLIPPED_PARTS];
	double bound[LP_NNLS_MAX] = {0.0};
	struct lp_ring_posterior posterior;
	struct lp_nnls normal;
	struct lp_ring_fit fit;

	lp_ring_fit(problem, used, &fit);
	const double s = fit.x[0];

	if (!(s > 0.0))
		return;
	lp_ring_normal(problem, &fit, &normal, bound);
	if (isnan(problem->scale.lux_per_unit))
		bound[0] = s / WIDEST;
	lp_ring_posterior(&normal, bound, &posterior);
	const double share = share_that_counts(problem, &fit);

	for (int j = 0; j < problem->view->count; j++) {
		const double best = fit.x[j + 1] / s;

		found[j] = (struct finding){share * best, posterior.mean[j + 1] - best,
					    (1.0 - share) * best};
	}
	mixture->weight += weight;
	mixture->scale += weight * s;
	mixture->scale2 += weight * (s * s + inflation * fit.scale_variance);
	for (int i = 0; i < problem->view->count; i++) {
		mixture->excess[i] += weight * found[i].excess;
		for (int j = 0; j < problem->view->count; j++)
			mixture->square[i][j] +=
				weight *
				(inflation * (posterior.covariance[i + 1][j + 1] +
					      found[i].off * found[j].off) +
				 found[i].held * found[j].held + found[i].excess * found[j].excess);
	}
}

/* Mean and covariance over the explanations (Bayesian model averaging: Hoeting et al. 1999). */
static void take(const struct mixture *m, int parts, struct lp_ring_fusion *fusion)
{
	const double scale = m->scale / m->weight;

	fusion->scale = (struct lp_ring_scale){
		(float)scale,
		(float)(sqrt(fmax(m->scale2 / m->weight - scale * scale, 0.0)) / scale)};
	for (int i = 0; i < parts; i++)
		fusion->excess[i] = (float)(m->excess[i] / m->weight);
	for (int i = 0; i < parts; i++) {
		for (int j = 0; j < parts; j++)
			fusion->covariance[i][j] =
				(float)(m->square[i][j] / m->weight -
					m->excess[i] / m->weight * m->excess[j] / m->weight);
		fusion->sigma[i] = sqrtf(fmaxf(fusion->covariance[i][i], 0.0F));
	}
}

/* What nearly all explanations, by weight, have in common. */
static void name(const struct lp_ring_explanation *list, const double *weight, int count,
		 uint32_t all, struct lp_ring_fusion *fusion)
{
	double total = 0.0, other_scale = 0.0, turned[LP_RING_SENSORS] = {0.0};
	double wrong[LP_RING_SENSORS] = {0.0};

	for (int i = 0; i < count; i++) {
		total += weight[i];
		other_scale += list[i].other_scale ? weight[i] : 0.0;
		turned[list[i].places] += weight[i];
		for (int k = 0; k < LP_RING_SENSORS && !list[i].places; k++)
			wrong[k] += all & ~list[i].used & 1U << k ? weight[i] : 0.0;
	}
	const double nearly_all = (1.0 - DOUBT) * total;

	fusion->scale_is_wrong = other_scale > nearly_all;
	for (int k = 0; k < LP_RING_SENSORS; k++)
		fusion->wrong |= wrong[k] > nearly_all ? 1U << k : 0U;
	for (int places = 1; places < LP_RING_SENSORS - 1; places++)
		if (turned[places] > nearly_all) {
			fusion->verdict = LP_RING_TURNED;
			fusion->turned_deg = 45.0F * (float)(places <= 4 ? places : places - 8);
		}
}

static double cost(const struct lp_ring_explanation *e)
{
	return e->cost + PRICE * e->price;
}

/* The best explanation; `given`: of those with the scale that was given. */
static const struct lp_ring_explanation *cheapest(const struct lp_ring_explanation *list, int count,
						  bool given)
{
	const struct lp_ring_explanation *best = &list[0];

	for (int i = 1; i < count; i++)
		if (cost(&list[i]) < cost(best) && !(given && list[i].other_scale))
			best = &list[i];
	return best;
}

/*
 * How likely each explanation is: the mean of two answers. By one of them another scale is the more
 * likely if it needs less hidden light; by the other one only the readings may speak for it. A
 * window hides light in all its parts, and a lamp may hide none, so that nobody knows how
 * surprising hidden light is: a scale that is right is not given up for it, nor is the sigma of one
 * that is wrong as if it were right.
 */
static void weigh(const struct lp_ring_explanation *list, int count, double inflation,
		  double *weight)
{
	const double least_price = cheapest(list, count, true)->price;

	memset(weight, 0, (size_t)count * sizeof(*weight));
	for (int answer = 0; answer < 2; answer++) {
		double all[LP_RING_EXPLANATIONS], least = INFINITY, sum = 0.0;

		for (int i = 0; i < count; i++) {
			const double saved = fmax(least_price - list[i].price, 0.0);

			all[i] = cost(&list[i]) +
				 (answer && list[i].other_scale ? PRICE * saved : 0.0);
			least = fmin(least, all[i]);
		}
		for (int i = 0; i < count; i++)
			sum += exp(-0.5 * (all[i] - least) / inflation);
		for (int i = 0; i < count; i++)
			weight[i] += 0.5 * exp(-0.5 * (all[i] - least) / inflation) / sum;
	}
	for (int i = 0; i < count; i++)
		weight[i] *= weight[i] > LEAST_WEIGHT;
}

/* How many readings of the sensors in `used` there are from before. */
static int used_before(const struct lp_ring_past *past, uint32_t used)
{
	int count = 0;

	for (int p = 0; p < past->count; p++)
		count += bits(usable(&past->list[p].sample) & used);
	return count;
}

/* Squared sigmas by which an explanation leaves the newest reading worse understood together with
 * those before than alone. `cost`: by which it leaves those before worse understood than their
 * sigmas allow; n looks count as sqrt(n), as in share_that_counts(). */
static double look_back_with(const struct lp_ring_problem *problem,
			     const struct lp_ring_explanation *alone, double *cost)
{
	struct lp_ring_case one;
	struct lp_ring_fit together;

	lp_ring_case_init(&one, problem, alone);
	lp_ring_fit(&one.problem, alone->used, &together);
	*cost = fmax(together.chi2 - alone->chi2 - used_before(&one.past, alone->used), 0.0) /
		sqrt(1 + problem->past->count);
	return together.misfit_now - alone->misfit_now;
}

/* What is wrong with a ring stays wrong: what explains the newest reading must explain those
 * before, too, or costs more. Returns false, and changes no cost, where each explanation needs
 * other light for the newest reading than for those before. */
static bool look_back(const struct lp_ring_problem *problem, struct lp_ring_explanation *list,
		      const double *weight, int count)
{
	double cost[LP_RING_EXPLANATIONS], least = INFINITY;

	for (int i = 0; i < count; i++) {
		cost[i] = INFINITY;
		if (weight[i] > 0.0)
			least = fmin(least, look_back_with(problem, &list[i], &cost[i]));
	}
	if (least > CHANGED)
		return false;
	for (int i = 0; i < count; i++)
		list[i].cost += cost[i];
	return true;
}

void lp_ring_fuse(const struct lp_ring_view *as_seen, const struct lp_ring_sample *sample,
		  const struct lp_ring_past *past, const struct lp_ring_scale *known,
		  struct lp_ring_fusion *fusion)
{
	struct lp_ring_explanation list[LP_RING_EXPLANATIONS];
	double weight[LP_RING_EXPLANATIONS];
	const uint32_t all = usable(sample);
	struct lp_ring_view view = *as_seen;
	struct mixture mixture = {0};

	*fusion = (struct lp_ring_fusion){.scale = *known};
	if (bits(all) < LP_RING_LEAST_USED)
		return;
	raise_bounds(&view);
	struct lp_ring_problem problem = {.view = &view, .sample = sample, .scale = *known};
	const int count = lp_ring_explain(&problem, all, list);
	const struct lp_ring_explanation *const best = cheapest(list, count, false);

	fusion->misfit = (float)(best->chi2 / best->freedom);
	fusion->verdict = LP_RING_AGREES;
	/* sigmas that are too small for what is left unexplained are taken for larger ones (Birge
	 * 1932), also where explanations are compared */
	const double inflation = fmax(fusion->misfit, 1.0);

	weigh(list, count, inflation, weight);
	if (past && past->count) {
		problem.past = past;
		fusion->changed = !look_back(&problem, list, weight, count);
		if (fusion->changed)
			problem.past = NULL;
		else
			weigh(list, count, inflation, weight);
	}
	name(list, weight, count, all, fusion);
	if (best->chi2 > ALWAYS_ALLOWED + MOST_MISFIT * best->freedom) {
		fusion->verdict = LP_RING_DISAGREES;
		return;
	}
	for (int i = 0; i < count; i++) {
		struct lp_ring_case one;

		if (!(weight[i] > 0.0))
			continue;
		lp_ring_case_init(&one, &problem, &list[i]);
		add(&one.problem, list[i].used, weight[i], inflation, &mixture);
	}
	if (mixture.weight > 0.0)
		take(&mixture, view.count, fusion);
}

float lp_ring_variance(const struct lp_ring_fusion *fusion, const struct lp_clipped_parts *parts)
{
	double sum = 0.0;

	/* mean over n of max(0, n.a) max(0, n.b): the arc-cosine kernel (Cho & Saul 2009, n = 1) */
	for (int i = 0; i < parts->count; i++)
		for (int j = 0; j < parts->count; j++) {
			const float *a = parts->list[i].direction, *b = parts->list[j].direction;
			const double cosine = fmin(fmax((double)a[0] * b[0] + (double)a[1] * b[1] +
								(double)a[2] * b[2],
							-1.0),
						   1.0);
			const double angle = acos(cosine);

			sum += fusion->covariance[i][j] * (sin(angle) + (M_PI - angle) * cosine) /
			       (6.0 * M_PI);
		}
	/* infinite sigmas times 0 */
	return isnan(sum) ? INFINITY : (float)fmax(sum, 0.0);
}
