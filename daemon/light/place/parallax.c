/* SPDX-License-Identifier: Apache-2.0 */
#include "light/place/parallax.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "light/linear/cholesky.h"
#include "light/linear/vector.h"

/* Parameters: two of the direction, the inverse distance, and how late poses are. */
enum { ALONG, ACROSS, INVERSE, LATE, SIZE };
#define ERRORS 6 /* of a pose: about and along three axes */
#define STEPS 4
/* A new place is so many sigmas of the pose from the one before, and so far at least. */
#define PLACE_SIGMAS 4.0
#define LEAST_STEP_M 0.04
/* Fewer places than this cannot disagree. */
#define LEAST_NODES 8
/* What contradicted itself is doubted for so long. */
#define DOUBT_S 10.0
/* What is known of a lamp before anything is seen: hardly one is nearer than 10 cm. */
#define INVERSE_SIGMA_PER_M 10.0
#define LEAST_LATE_SIGMA_S 1e-4
/* After one step at least this share of the distance to a lamp is left: else the step is wrong. */
#define LEAST_LEFT 0.1
/* A smaller nearest distance is not sent: any lamp is as far away. */
#define LEAST_NEAREST_M 0.3
/* A node, or a sighting, so many sigmas off is an outlier: now and then pixels show another lamp,
 * or half of one. More of the nodes than this share, or so many sightings in a row, are none. */
#define OUTLIER_SIGMAS 3.0
#define MOST_OUTLIERS 0.25
#define MOST_MISSES 8
#define MISS_SIGMAS 5.0
/* After so many in a row no distance is stated. */
#define SEVERAL_MISSES 2
/* A lamp that seems weaker by so much, relative, or by so many sigmas, may be so by noise; by more,
 * it is hidden in part. */
#define STRENGTH_NOISE 0.03
#define STRENGTH_SIGMAS 3.0
/* No place, time or sigma of a pose is larger (m, m/s, rad, rad/s, s), and no sigma is less. */
#define MOST_OF_A_POSE 1e9
#define LEAST_SIGMA_RAD 1e-7
#define MOST_NOT_UNIT 0.01 /* of a direction's squared length */
/* An inverse distance so many sigmas below 0: no lamp is there. */
#define BEYOND_SIGMAS 4.0

/* Of numbers, each at least `least`. */
static bool are_sane(const double *values, int count, double least)
{
	for (int k = 0; k < count; k++)
		if (!(values[k] >= least && values[k] <= MOST_OF_A_POSE))
			return false;
	return true;
}

bool lp_probe_pose_is_sane(const struct lp_probe_pose *pose)
{
	const double sigmas[3] = {pose->sigma_rad, pose->sigma_m, pose->late_sigma_s};

	return are_sane(sigmas, 3, 0.0) && are_sane(pose->position_m, 3, -MOST_OF_A_POSE) &&
	       are_sane(pose->rate_rad_s, 3, -MOST_OF_A_POSE) &&
	       are_sane(pose->velocity_m_s, 3, -MOST_OF_A_POSE);
}

static bool is_sane(const struct lp_parallax_sighting *sighting)
{
	const double of_it[4] = {sighting->sigma_rad, sighting->irradiance, sighting->radius_rad,
				 sighting->strength_sigma};
	const double length2 = (double)sighting->direction[0] * sighting->direction[0] +
			       (double)sighting->direction[1] * sighting->direction[1] +
			       (double)sighting->direction[2] * sighting->direction[2];

	return are_sane(of_it, 4, 0.0) && fabs(length2 - 1.0) < MOST_NOT_UNIT;
}

static double apart_m(const double a[3], const double b[3])
{
	const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};

	return sqrt(lp_dot(d, d));
}

/* ---------------------------------------------------------------- nodes */

static void join(struct lp_parallax_node *node, const struct lp_parallax_node *other)
{
	const double count = node->count + other->count, share = other->count / count;

	if (!(node->irradiance > 0.0)) /* not known: as in the other */
		node->irradiance = other->irradiance;
#define MEAN(field) (node->field += share * (other->field - node->field))
	for (int a = 0; a < 3; a++) {
		MEAN(direction[a]);
		MEAN(position_m[a]);
		MEAN(rate_rad_s[a]);
		MEAN(velocity_m_s[a]);
	}
	MEAN(t_s);
	MEAN(variance);
	if (other->irradiance > 0.0)
		MEAN(irradiance);
	MEAN(radius_rad);
	MEAN(strength_sigma);
	MEAN(pose_variance_rad2);
	MEAN(pose_variance_m2);
#undef MEAN
	(void)lp_normalise(node->direction);
	node->count = count;
}

static void drop(struct lp_parallax *p, int at)
{
	p->count--;
	memmove(p->nodes + at, p->nodes + at + 1, (size_t)(p->count - at) * sizeof(*p->nodes));
}

/* Room for one more: of those that follow each other the two nearest become one. */
static void make_room(struct lp_parallax *p)
{
	double best = INFINITY;
	int at = 0;

	if (p->count < LP_PARALLAX_NODES)
		return;
	for (int k = 0; k + 1 < p->count; k++) {
		const double gone = apart_m(p->nodes[k].position_m, p->nodes[k + 1].position_m);

		if (gone < best) {
			best = gone;
			at = k;
		}
	}
	join(&p->nodes[at], &p->nodes[at + 1]);
	drop(p, at + 1);
}

static void add(struct lp_parallax *p, const struct lp_parallax_node *seen)
{
	struct lp_parallax_node *newest = p->count ? &p->nodes[p->count - 1] : NULL;
	const double step_m = fmax(PLACE_SIGMAS * sqrt(seen->pose_variance_m2), LEAST_STEP_M);

	if (newest && apart_m(newest->position_m, seen->position_m) < step_m) {
		join(newest, seen);
		return;
	}
	make_room(p);
	p->nodes[p->count++] = *seen;
}

/* ---------------------------------------------------------------- the fit */

/* What one node says of the parameters. */
struct equation {
	double residual[2];
	double slope[2][SIZE];
	double pose[2][ERRORS]; /* by 1 sigma of each error of its pose */
	double variance;	/* rad^2, of what was seen, apart from the pose */
	double weight;		/* inverse variance of each residual */
};

struct fit {
	struct lp_parallax_fit found;
	double prior[SIZE]; /* inverse variance of each parameter about 0 */
	double normal[SIZE][SIZE], right[SIZE];
	double strongest; /* irradiance at the distance of here_m, of all nodes */
	double hidden;	  /* share of the lamp, root mean square of all nodes */
	int outliers;
	double misfit; /* sum of squares, in sigmas; of outliers no more than at their limit */
};

/* From where the node says that it was, the lamp of the fit; how deep it lies along what was seen.
 * False: the fit has gone astray. */
static bool look(const struct fit *fit, const struct lp_parallax_node *node, double toward[3],
		 double *depth)
{
	for (int a = 0; a < 3; a++)
		toward[a] = fit->found.direction[a] -
			    fit->found.inverse_per_m * (node->position_m[a] - fit->found.here_m[a]);
	*depth = lp_dot(node->direction, toward);
	return *depth > 0.1;
}

/* As strong as it would be at the distance of here_m. */
static double strength(const struct lp_parallax_node *node, const double toward[3])
{
	return node->irradiance * lp_dot(toward, toward);
}

/* Share of the lamp that is hidden, against where it is seen best. */
static double hidden_share(const struct fit *fit, double strength, double strength_sigma)
{
	const bool known = fit->strongest > 0.0 && strength > 0.0;

	const double noise = fmax(STRENGTH_SIGMAS * strength_sigma, STRENGTH_NOISE);

	return known ? fmax(1.0 - strength / fit->strongest - noise, 0.0) : 0.0;
}

static void find_hidden(struct fit *fit, const struct lp_parallax *p)
{
	double strengths[LP_PARALLAX_NODES] = {0.0}, toward[3], depth;
	double square = 0.0;

	fit->strongest = fit->hidden = 0.0;
	for (int k = 0; k < p->count; k++) {
		if (look(fit, &p->nodes[k], toward, &depth))
			strengths[k] = strength(&p->nodes[k], toward);
		fit->strongest = fmax(fit->strongest, strengths[k]);
	}
	for (int k = 0; k < p->count; k++)
		square += pow(hidden_share(fit, strengths[k], p->nodes[k].strength_sigma), 2.0);
	fit->hidden = sqrt(square / fmax(p->count, 1.0));
}

/* How far the middle of what is seen may lie from the lamp's. Where a part is hidden from some
 * places, one may be hidden from those, too, from which it is seen best. */
static double hidden_rad(const struct fit *fit, const struct lp_parallax_node *node,
			 const double toward[3])
{
	return node->radius_rad *
	       fmax(hidden_share(fit, strength(node, toward), node->strength_sigma), fit->hidden);
}

static bool equation_of(const struct fit *fit, const struct lp_parallax_node *node,
			struct equation *e)
{
	double toward[3], depth, basis[2][3], along[2][3], late[3];

	if (!look(fit, node, toward, &depth))
		return false;
	const double nearness = fit->found.inverse_per_m / depth;
	const double sigma_rad = sqrt(node->pose_variance_rad2);
	const double sigma_m = sqrt(node->pose_variance_m2);

	lp_across(node->direction, basis);
	lp_across(fit->found.direction, along);
	lp_cross(node->rate_rad_s, node->direction, late);
	for (int a = 0; a < 3; a++)
		late[a] += nearness * node->velocity_m_s[a];
	for (int i = 0; i < 2; i++) {
		double lever[3];

		e->residual[i] = lp_dot(basis[i], toward) / depth -
				 fit->found.late_s * lp_dot(basis[i], late);
		e->slope[i][ALONG] = lp_dot(basis[i], along[0]) / depth;
		e->slope[i][ACROSS] = lp_dot(basis[i], along[1]) / depth;
		e->slope[i][INVERSE] = -(lp_dot(basis[i], node->position_m) -
					 lp_dot(basis[i], fit->found.here_m)) /
				       depth;
		e->slope[i][LATE] = -lp_dot(basis[i], late);
		lp_cross(node->direction, basis[i], lever);
		for (int a = 0; a < 3; a++) {
			e->pose[i][a] = sigma_rad * lever[a];
			e->pose[i][3 + a] = sigma_m * nearness * basis[i][a];
		}
	}
	const double aside_rad = hidden_rad(fit, node, toward);

	e->variance = node->variance + aside_rad * aside_rad;
	e->weight = 1.0 / (e->variance + node->pose_variance_rad2 +
			   nearness * nearness * node->pose_variance_m2);
	return true;
}

/* How far what was seen is from the fit, in sigmas. */
static double off(const struct equation *e)
{
	return sqrt(e->weight *
		    (e->residual[0] * e->residual[0] + e->residual[1] * e->residual[1]));
}

/* An outlier pulls no harder than at its limit (Huber 1964). */
static void add_equation(struct fit *fit, const struct equation *e)
{
	const double weight = e->weight * fmin(1.0, OUTLIER_SIGMAS / fmax(off(e), 1e-9));

	fit->outliers += off(e) > OUTLIER_SIGMAS;
	fit->misfit += fmin(off(e) * off(e), OUTLIER_SIGMAS * OUTLIER_SIGMAS);
	for (int i = 0; i < 2; i++) {
		for (int a = 0; a < SIZE; a++) {
			fit->right[a] -= weight * e->slope[i][a] * e->residual[i];
			for (int b = 0; b < SIZE; b++)
				fit->normal[a][b] += weight * e->slope[i][a] * e->slope[i][b];
		}
	}
}

static bool sum_up(struct fit *fit, const struct lp_parallax *p)
{
	struct equation e;

	memset(fit->normal, 0, sizeof(fit->normal));
	memset(fit->right, 0, sizeof(fit->right));
	fit->outliers = 0;
	fit->misfit = 0.0;
	find_hidden(fit, p);
	for (int a = 0; a < SIZE; a++)
		fit->normal[a][a] = fit->prior[a];
	fit->right[INVERSE] = -fit->prior[INVERSE] * fit->found.inverse_per_m;
	fit->right[LATE] = -fit->prior[LATE] * fit->found.late_s;
	for (int k = 0; k < p->count; k++) {
		if (!equation_of(fit, &p->nodes[k], &e))
			return false;
		add_equation(fit, &e);
	}
	return true;
}

static bool step(struct fit *fit)
{
	double by[SIZE], along[2][3];

	if (!lp_cholesky_solve(SIZE, fit->normal[0], fit->right, by))
		return false;
	lp_across(fit->found.direction, along);
	for (int a = 0; a < 3; a++)
		fit->found.direction[a] += by[ALONG] * along[0][a] + by[ACROSS] * along[1][a];
	fit->found.inverse_per_m =
		(fit->found.inverse_per_m + by[INVERSE]) / lp_normalise(fit->found.direction);
	fit->found.late_s += by[LATE];
	return true;
}

/*
 * Variance of the inverse distance, whose change by each parameter is `of`. The pictures' errors
 * are independent; the poses' fade into each other (Ornstein-Uhlenbeck), so that what they bring is
 * summed up along the way: `past` is what the errors of all nodes before still do at this one.
 */
static double variance_of(const struct fit *fit, const struct lp_parallax *p, const double of[SIZE])
{
	double gain[SIZE], past[ERRORS] = {0}, variance = 0.0;
	struct equation e;

	if (!lp_cholesky_solve(SIZE, fit->normal[0], of, gain))
		return NAN;
	for (int a = 0; a < SIZE; a++)
		variance += gain[a] * gain[a] * fit->prior[a];
	for (int k = 0; k < p->count; k++) {
		const struct lp_parallax_node *node = &p->nodes[k];
		const double since_s = k ? fabs(node->t_s - p->nodes[k - 1].t_s) : 0.0;
		const double kept = exp(-since_s / LP_POSE_MEMORY_S);
		double now[ERRORS] = {0};

		if (!equation_of(fit, node, &e))
			return NAN;
		for (int i = 0; i < 2; i++) {
			double by = 0.0;

			for (int a = 0; a < SIZE; a++)
				by += gain[a] * e.weight * e.slope[i][a];
			variance += by * by * e.variance;
			for (int a = 0; a < ERRORS; a++)
				now[a] += by * e.pose[i][a];
		}
		for (int a = 0; a < ERRORS; a++) {
			past[a] *= kept;
			variance += now[a] * (now[a] + 2.0 * past[a]);
			past[a] += now[a];
		}
	}
	return variance;
}

static bool solve(struct lp_parallax *p, const struct lp_probe_pose *pose,
		  const double direction[3])
{
	const double late = fmax(pose->late_sigma_s, LEAST_LATE_SIGMA_S);
	struct fit fit = {.found = {.inverse_per_m = p->inverse_per_m},
			  .prior = {[INVERSE] = 1.0 / (INVERSE_SIGMA_PER_M * INVERSE_SIGMA_PER_M),
				    [LATE] = 1.0 / (late * late)}};

	memcpy(fit.found.here_m, pose->position_m, sizeof(fit.found.here_m));
	memcpy(fit.found.direction, direction, sizeof(fit.found.direction));
	for (int k = 0; k < STEPS; k++)
		if (!sum_up(&fit, p) || !step(&fit))
			return false;
	if (!sum_up(&fit, p) || fit.outliers > fmax(MOST_OUTLIERS * p->count, 1.0))
		return false;
	/* The present place is late, too, and has the error of any place. */
	const double inverse2 = fit.found.inverse_per_m * fit.found.inverse_per_m;
	const double nearer = inverse2 * lp_dot(pose->velocity_m_s, fit.found.direction);
	const double of[SIZE] = {[INVERSE] = 1.0, [LATE] = nearer};
	/* where nodes scatter more than their sigmas say, the sigma grows by as much */
	const double scatter = fmax(fit.misfit / fmax(2.0 * p->count - SIZE, 1.0), 1.0);
	const double variance = scatter * variance_of(&fit, p, of) +
				inverse2 * inverse2 * pose->sigma_m * pose->sigma_m;

	if (!(variance >= 0.0) || fit.found.inverse_per_m < -BEYOND_SIGMAS * sqrt(variance))
		return false;
	p->fit = fit.found;
	p->inverse_per_m = fit.found.inverse_per_m + nearer * fit.found.late_s;
	p->sigma_per_m = sqrt(variance);
	return true;
}

/* Whether what is known explains a sighting; unknown explains everything. */
static bool explains(const struct lp_parallax *p, const struct lp_parallax_node *seen)
{
	struct fit fit = {.found = p->fit};
	struct equation e;

	if (p->count < LEAST_NODES || !(p->sigma_per_m > 0.0))
		return true;
	find_hidden(&fit, p);
	return equation_of(&fit, seen, &e) && off(&e) < MISS_SIGMAS;
}

/* Nothing is left but what is seen now. */
static void begin_again(struct lp_parallax *p, const struct lp_parallax_node *seen)
{
	p->nodes[0] = *seen;
	p->count = 1;
	p->misses = 0;
	p->inverse_per_m = p->sigma_per_m = 0.0;
	p->doubt += 1.0;
}

void lp_parallax_see(struct lp_parallax *p, const struct lp_probe_pose *pose,
		     const struct lp_parallax_sighting *sighting)
{
	const double in_anchor[3] = {sighting->direction[0], sighting->direction[1],
				     sighting->direction[2]};
	const double sigma_rad = fmax((double)sighting->sigma_rad, LEAST_SIGMA_RAD);
	struct lp_parallax_node seen = {.t_s = (double)pose->t_ns / 1e9,
					.count = 1.0,
					.variance = sigma_rad * sigma_rad,
					.irradiance = sighting->irradiance,
					.radius_rad = sighting->radius_rad,
					.strength_sigma = sighting->strength_sigma,
					.pose_variance_rad2 = pose->sigma_rad * pose->sigma_rad,
					.pose_variance_m2 = pose->sigma_m * pose->sigma_m};

	if (!lp_probe_pose_is_sane(pose) || !is_sane(sighting))
		return;
	lp_rotate(&pose->rotation, in_anchor, seen.direction);
	memcpy(seen.position_m, pose->position_m, sizeof(seen.position_m));
	memcpy(seen.rate_rad_s, pose->rate_rad_s, sizeof(seen.rate_rad_s));
	memcpy(seen.velocity_m_s, pose->velocity_m_s, sizeof(seen.velocity_m_s));
	if (p->world != pose->world)
		*p = (struct lp_parallax){.world = pose->world};
	p->doubt *= exp(-fmax(seen.t_s - p->t_doubt_s, 0.0) / DOUBT_S);
	p->t_doubt_s = seen.t_s;
	p->misses = explains(p, &seen) ? 0 : p->misses + 1;
	if (p->misses > MOST_MISSES) {
		begin_again(p, &seen);
		return;
	}
	if (p->misses)
		return;
	add(p, &seen);
	if (p->count >= 2 && !solve(p, pose, seen.direction))
		begin_again(p, &seen);
}

double lp_nearer(const double way_m[3], double inverse_per_m, float direction[3])
{
	double toward[3];

	for (int a = 0; a < 3; a++)
		toward[a] = (double)direction[a] - inverse_per_m * way_m[a];
	const double left = lp_normalise(toward);

	if (!(left > LEAST_LEFT && isfinite(left)))
		return 1.0;
	for (int a = 0; a < 3; a++)
		direction[a] = (float)toward[a];
	return 1.0 / left;
}

float lp_parallax_go(struct lp_parallax *p, const double way_m[3], double sigma_m,
		     float direction[3], float *nearer)
{
	*nearer = 1.0F;
	if (isnan(lp_parallax_distance(p).distance_m))
		return 0.0F;
	const double variance = p->sigma_per_m * p->sigma_per_m * lp_dot(way_m, way_m) +
				p->inverse_per_m * p->inverse_per_m * sigma_m * sigma_m;

	*nearer = (float)lp_nearer(way_m, p->inverse_per_m, direction);
	p->inverse_per_m *= (double)*nearer;
	return (float)variance;
}

double lp_parallax_doubt(const struct lp_parallax *p)
{
	return p->doubt + (p->misses >= SEVERAL_MISSES ? 1.0 : 0.0);
}

struct lp_lamp_distance lp_parallax_distance(const struct lp_parallax *p)
{
	struct lp_lamp_distance d = {NAN, NAN, 0.0F};
	const double most_per_m = fmax(p->inverse_per_m, 0.0) + LP_PARALLAX_SIGMAS * p->sigma_per_m;

	if (!(p->sigma_per_m > 0.0) || p->count < LEAST_NODES ||
	    lp_parallax_doubt(p) > LP_PARALLAX_MOST_DOUBT)
		return d;
	if (p->inverse_per_m > LP_PARALLAX_SIGMAS * p->sigma_per_m) {
		d.distance_m = (float)(1.0 / p->inverse_per_m);
		d.sigma = (float)(p->sigma_per_m / p->inverse_per_m);
	} else if (1.0 / most_per_m > LEAST_NEAREST_M) {
		d.nearest_m = (float)(1.0 / most_per_m);
	}
	return d;
}
