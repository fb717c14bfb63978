/* SPDX-License-Identifier: Apache-2.0 */
#include "serve/drawn/drawn_light.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "include/luminance.h"
#include "light/linear/vector.h"
#include "light/math/sh.h"
#include "light/send/key.h"

#define RAD (M_PI / 180.0)
#define COUNT LP_FINE_SH_COUNT
/* A ball as large as its distance from the table, and points of the table under it, in units of its
 * radius: as tests/bench/drawn.py, with fewer points. */
#define HEIGHT 1.2
#define REACH 3.0
#define ROW 6
#define POINTS (ROW * ROW)
/* Directions above the table; directions in which a surface is looked at; rays of a wide light. */
#define ABOVE 128
#define VIEWS 96
#define RAYS 19

struct lp_drawn_tables {
	float basis[ABOVE][COUNT];
	float seen[POINTS][ABOVE]; /* what radiance from there brings to a point */
	float open[ABOVE];	   /* the same without the ball */
	float views[VIEWS][COUNT]; /* blurred by LP_GLOSSY_DEG */
	double view[VIEWS][3];	   /* directions */
	double centre[POINTS][3];  /* of the ball, from each point */
};

/* Light that the packet or the room has besides SH: on the table and on a glossy surface. */
struct shown {
	float table[POINTS], glossy[VIEWS];
};

/* The estimate as luminance. */
struct lights {
	int count;
	double strength[LP_MAX_LIGHTS]; /* irradiance at normal incidence */
	double basis[LP_MAX_LIGHTS][COUNT];
	struct shown shown[LP_MAX_LIGHTS];
	bool wide[LP_MAX_LIGHTS];
};

double lp_drawn_lobe(double blur_rad, double cosine)
{
	const double kappa = 1.0 / (blur_rad * blur_rad);

	return kappa / (2.0 * M_PI * (1.0 - exp(-2.0 * kappa))) * exp(kappa * (cosine - 1.0));
}

void lp_drawn_spread(int index, int count, double direction[3])
{
	const double y = 1.0 - (2.0 * index + 1.0) / count, across = sqrt(1.0 - y * y);
	const double phi = M_PI * (1.0 + sqrt(5.0)) * (index + 0.5);

	direction[0] = across * cos(phi);
	direction[1] = y;
	direction[2] = across * sin(phi);
}

static bool is_hidden(const double centre[3], const double direction[3])
{
	const double way = lp_dot(centre, direction);

	return way > 0.0 && lp_dot(centre, centre) - way * way < 1.0;
}

/* Band factors of the lobe, by the recurrence of the spherical Bessel functions. */
static void lobe_bands(double blur_rad, double factor[LP_SH_MAX_ORDER + 1])
{
	const double kappa = 1.0 / (blur_rad * blur_rad);

	factor[0] = 1.0;
	factor[1] = 1.0 / tanh(kappa) - 1.0 / kappa;
	for (int l = 2; l <= LP_SH_MAX_ORDER; l++)
		factor[l] = fmax(factor[l - 2] - (2 * l - 1) / kappa * factor[l - 1], 0.0);
}

static void fill_table(struct lp_drawn_tables *tables)
{
	for (int p = 0; p < POINTS; p++) {
		tables->centre[p][0] = REACH * (1.0 - 2.0 * (p % ROW) / (ROW - 1));
		tables->centre[p][1] = HEIGHT;
		tables->centre[p][2] = REACH * (1.0 - 2.0 * (p / ROW) / (ROW - 1));
	}
	for (int d = 0; d < ABOVE; d++) {
		double direction[3], y[COUNT];

		lp_drawn_spread(d, 2 * ABOVE, direction); /* the upper half comes first */
		lp_sh_basis(LP_SH_MAX_ORDER, direction, y);
		for (int i = 0; i < COUNT; i++)
			tables->basis[d][i] = (float)y[i];
		tables->open[d] = (float)(2.0 * M_PI / ABOVE * direction[1]);
		for (int p = 0; p < POINTS; p++)
			tables->seen[p][d] =
				is_hidden(tables->centre[p], direction) ? 0.0F : tables->open[d];
	}
}

struct lp_drawn_tables *lp_drawn_tables_create(void)
{
	struct lp_drawn_tables *self = calloc(1, sizeof(*self));
	double factor[LP_SH_MAX_ORDER + 1], y[COUNT];

	if (!self)
		return NULL;
	fill_table(self);
	lobe_bands(LP_GLOSSY_DEG * RAD, factor);
	for (int v = 0; v < VIEWS; v++) {
		lp_drawn_spread(v, VIEWS, self->view[v]);
		lp_sh_basis(LP_SH_MAX_ORDER, self->view[v], y);
		for (int l = 0; l <= LP_SH_MAX_ORDER; l++)
			for (int i = l * l; i < (l + 1) * (l + 1); i++)
				self->views[v][i] = (float)(factor[l] * y[i]);
	}
	return self;
}

void lp_drawn_tables_destroy(struct lp_drawn_tables *tables)
{
	free(tables);
}

/* ---------------------------------------------------------------- lights */

/* Ray `index` over a light's disc or ellipse. */
static void ray_of(const struct lp_light *light, int index, double ray[3])
{
	const double along[3] = {light->direction[0], light->direction[1], light->direction[2]};
	const bool wide = light->flags & LP_LIGHT_EXTENDED;
	double first[3] = {light->axis[0], light->axis[1], light->axis[2]}, second[3];
	const double k = index + 0.5, radius = sqrt(k / RAYS);
	const double phi = M_PI * (1.0 + sqrt(5.0)) * k;
	const double half[2] = {wide ? light->half_angle_deg[0] : light->angular_radius_deg,
				wide ? light->half_angle_deg[1] : light->angular_radius_deg};

	if (!wide) { /* any axis across it */
		const int least = fabs(along[0]) < 0.7 ? 0 : 1;

		memset(first, 0, sizeof(first));
		first[least] = 1.0;
		const double share = lp_dot(first, along);

		for (int a = 0; a < 3; a++)
			first[a] -= share * along[a];
		const double length = sqrt(lp_dot(first, first));

		for (int a = 0; a < 3; a++)
			first[a] /= length;
	}
	for (int a = 0; a < 3; a++) {
		const int b = (a + 1) % 3, c = (a + 2) % 3;

		second[a] = along[b] * first[c] - along[c] * first[b];
	}
	for (int a = 0; a < 3; a++)
		ray[a] = along[a] + tan(fmin(half[0], 80.0) * RAD) * radius * cos(phi) * first[a] +
			 tan(fmin(half[1], 80.0) * RAD) * radius * sin(phi) * second[a];
	const double length = sqrt(lp_dot(ray, ray));

	for (int a = 0; a < 3; a++)
		ray[a] /= length;
}

static void show_light(const struct lp_drawn_tables *tables, const struct lp_light *light,
		       double strength, struct shown *shown)
{
	const double direction[3] = {light->direction[0], light->direction[1], light->direction[2]};
	const double radius = light->angular_radius_deg * RAD;
	const double blur = sqrt(LP_GLOSSY_DEG * RAD * LP_GLOSSY_DEG * RAD + radius * radius / 4.0);

	memset(shown->table, 0, sizeof(shown->table));
	for (int r = 0; r < RAYS; r++) {
		double ray[3];

		ray_of(light, r, ray);
		if (!(ray[1] > 0.0))
			continue;
		for (int p = 0; p < POINTS; p++)
			if (!is_hidden(tables->centre[p], ray))
				shown->table[p] += (float)(strength / RAYS * ray[1]);
	}
	for (int v = 0; v < VIEWS; v++)
		shown->glossy[v] =
			(float)(strength * lp_drawn_lobe(blur, lp_dot(tables->view[v], direction)));
}

static void read_lights(const struct lp_drawn_tables *tables,
			const struct lp_light_estimate *estimate, struct lights *lights)
{
	lights->count = estimate->light_count;
	for (int k = 0; k < lights->count; k++) {
		const struct lp_light *light = &estimate->lights[k];
		const double direction[3] = {light->direction[0], light->direction[1],
					     light->direction[2]};

		lights->strength[k] = lp_luminance(light->irradiance);
		lights->wide[k] = light->flags & LP_LIGHT_EXTENDED;
		lp_sh_basis(LP_SH_MAX_ORDER, direction, lights->basis[k]);
		show_light(tables, light, lights->strength[k], &lights->shown[k]);
	}
}

/* ---------------------------------------------------------------- what is drawn */

/* SH up to an order, by its radiance above the table and its blurred radiance, above 0. */
struct smooth {
	float above[ABOVE], views[VIEWS];
};

/* Add bands `from` to `to` to sums that may be negative. */
static void add_bands(const struct lp_drawn_tables *tables, const float *sh, int from, int to,
		      struct smooth *sum)
{
	const int first = from * from, end = (to + 1) * (to + 1);

	for (int d = 0; d < ABOVE; d++)
		for (int i = first; i < end; i++)
			sum->above[d] += sh[i] * tables->basis[d][i];
	for (int v = 0; v < VIEWS; v++)
		for (int i = first; i < end; i++)
			sum->views[v] += sh[i] * tables->views[v][i];
}

static float on_screen(float radiance, float mean)
{
	const float positive = fmaxf(radiance, 0.0F);

	return positive / (positive + mean);
}

/* Room as it is known: table and glossy surface. */
struct room {
	struct shown shown;
	float open; /* on the table without the ball */
	float mean; /* radiance */
};

static void show(const struct lp_drawn_tables *tables, const struct smooth *smooth,
		 struct shown *shown)
{
	float positive[ABOVE];

	for (int d = 0; d < ABOVE; d++)
		positive[d] = fmaxf(smooth->above[d], 0.0F);
	for (int p = 0; p < POINTS; p++) {
		float sum = 0.0F;

		for (int d = 0; d < ABOVE; d++)
			sum += tables->seen[p][d] * positive[d];
		shown->table[p] = sum;
	}
	for (int v = 0; v < VIEWS; v++)
		shown->glossy[v] = fmaxf(smooth->views[v], 0.0F);
}

static void add_shown(struct shown *sum, const struct shown *part)
{
	for (int p = 0; p < POINTS; p++)
		sum->table[p] += part->table[p];
	for (int v = 0; v < VIEWS; v++)
		sum->glossy[v] += part->glossy[v];
}

static void look_at_room(const struct lp_drawn_tables *tables,
			 const struct lp_light_estimate *estimate, const struct lights *lights,
			 const float total[COUNT], struct room *room)
{
	struct smooth smooth = {{0.0F}, {0.0F}};
	float rest[COUNT];

	memcpy(rest, total, sizeof(rest));
	for (int k = 0; k < lights->count; k++)
		for (int i = 0; i < COUNT && !lights->wide[k]; i++)
			rest[i] -= (float)(lights->strength[k] * lights->basis[k][i]);
	add_bands(tables, rest, 0, LP_SH_MAX_ORDER, &smooth);
	show(tables, &smooth, &room->shown);
	room->mean = total[0] / (float)sqrt(4.0 * M_PI);
	room->open = 0.0F;
	for (int d = 0; d < ABOVE; d++)
		room->open += tables->open[d] * fmaxf(smooth.above[d], 0.0F);
	for (int k = 0; k < lights->count; k++) {
		if (lights->wide[k])
			continue;
		add_shown(&room->shown, &lights->shown[k]);
		room->open +=
			(float)lights->strength[k] * fmaxf(estimate->lights[k].direction[1], 0.0F);
	}
}

/* Root mean squares of what differs. */
static void compare(const struct room *room, const struct shown *shown, float *shadows,
		    float *glossy)
{
	float sum = 0.0F;

	for (int p = 0; p < POINTS; p++) {
		const float off = shown->table[p] - room->shown.table[p];

		sum += off * off;
	}
	*shadows = room->open > 0.0F ? sqrtf(sum / POINTS) / room->open : 0.0F;
	sum = 0.0F;
	for (int v = 0; v < VIEWS; v++) {
		const float off = on_screen(shown->glossy[v], room->mean) -
				  on_screen(room->shown.glossy[v], room->mean);

		sum += off * off;
	}
	*glossy = sqrtf(sum / VIEWS);
}

/* Of the irradiance in the bands above each order, relative to its mean. */
static void leave_bands_out(const float sh[COUNT], float mean, float error[LP_MAX_SH_ORDER + 1])
{
	double sum = 0.0;

	for (int l = LP_SH_MAX_ORDER; l > 0; l--) {
		const double a = lp_sh_cosine(l);

		for (int i = l * l; i < (l + 1) * (l + 1); i++)
			sum += a * a * (double)sh[i] * (double)sh[i];
		if (l - 1 <= LP_MAX_SH_ORDER)
			error[l - 1] = (float)(sqrt(sum / (4.0 * M_PI)) / (M_PI * (double)mean));
	}
}

/* KEY of what is left, taken out of it. */
static void take_key(const struct lp_drawn_tables *tables, float sh[COUNT], struct shown *shown)
{
	float first[4][3];
	double basis[COUNT];

	for (int i = 0; i < 4; i++)
		for (int c = 0; c < 3; c++)
			first[i][c] = sh[i];
	const struct lp_light key = lp_key_light((const float(*)[3])first);
	const float strength = lp_luminance(key.irradiance);

	lp_sh_basis(LP_SH_MAX_ORDER,
		    (const double[]){key.direction[0], key.direction[1], key.direction[2]}, basis);
	for (int i = 0; i < COUNT; i++)
		sh[i] -= strength * (float)basis[i];
	show_light(tables, &key, strength, shown);
}

/* All orders with the lights in `listed`; `sh`: what remains of the total. */
static void predict_orders(const struct lp_drawn_tables *tables, const struct room *room,
			   const struct shown *listed, const float sh[COUNT], int k,
			   struct lp_drawn_models *models)
{
	struct smooth smooth = {{0.0F}, {0.0F}};
	float diffuse[LP_MAX_SH_ORDER + 1];

	leave_bands_out(sh, room->mean, diffuse);
	for (int l = 0; l <= LP_MAX_SH_ORDER; l++) {
		struct shown shown;

		add_bands(tables, sh, l, l, &smooth);
		show(tables, &smooth, &shown);
		add_shown(&shown, listed);
		models->left_out[LP_DRAWN_DIFFUSE][l][k] = diffuse[l];
		compare(room, &shown, &models->left_out[LP_DRAWN_SHADOWS][l][k],
			&models->left_out[LP_DRAWN_GLOSSY][l][k]);
	}
}

/* All light is off by the same share. */
static float even_slope(const struct room *room)
{
	float sum = 0.0F;

	for (int v = 0; v < VIEWS; v++) {
		const float share = on_screen(room->shown.glossy[v], room->mean);
		const float slope = share * (1.0F - share);

		sum += slope * slope;
	}
	return sqrtf(sum / VIEWS);
}

/* One lamp is off, by so much that its irradiance on all normals is by that share of the mean: of a
 * lamp of irradiance E the root mean square over normals is E / sqrt(6). */
static float lamp_slope(const struct room *room, const struct shown *lamp, double strength)
{
	const float more = (float)(sqrt(6.0) * M_PI / strength);
	float sum = 0.0F;

	for (int v = 0; v < VIEWS; v++) {
		const float rest = 1.0F - on_screen(room->shown.glossy[v], room->mean);
		const float slope = more * lamp->glossy[v] * rest * rest;

		sum += slope * slope;
	}
	return sqrtf(sum / VIEWS);
}

/* The larger of the two: nobody knows which light is off. */
static float slope_of(const struct room *room, const struct lights *lights)
{
	float most = even_slope(room);

	for (int k = 0; k < lights->count; k++)
		if (lights->strength[k] > 0.0)
			most = fmaxf(most,
				     lamp_slope(room, &lights->shown[k], lights->strength[k]));
	return most;
}

void lp_drawn_predict(const struct lp_drawn_tables *tables,
		      const struct lp_light_estimate *estimate, bool key,
		      struct lp_drawn_models *models)
{
	struct lights lights;
	struct room room;
	struct shown listed = {{0.0F}, {0.0F}};
	float total[COUNT], left[COUNT];

	memset(models, 0, sizeof(*models));
	for (int i = 0; i < COUNT; i++)
		total[i] = i < LP_MAX_SH_COUNT ? lp_luminance(estimate->sh_total[i])
					       : estimate->fine_sh[i];
	if (!(total[0] > 0.0F))
		return;
	read_lights(tables, estimate, &lights);
	look_at_room(tables, estimate, &lights, total, &room);
	models->screen_slope = slope_of(&room, &lights);
	memcpy(left, total, sizeof(left));
	for (int k = 0; k <= LP_MAX_LIGHTS; k++) {
		struct shown with_key = listed;
		float remains[COUNT];

		if (k > lights.count) {
			for (int t = 0; t < LP_DRAWN_BY_MODEL; t++)
				for (int l = 0; l <= LP_MAX_SH_ORDER; l++)
					models->left_out[t][l][k] = models->left_out[t][l][k - 1];
			continue;
		}
		memcpy(remains, left, sizeof(remains));
		if (key) {
			struct shown own;

			take_key(tables, remains, &own);
			add_shown(&with_key, &own);
		}
		predict_orders(tables, &room, &with_key, remains, k, models);
		if (k == lights.count)
			continue;
		add_shown(&listed, &lights.shown[k]);
		for (int i = 0; i < COUNT; i++)
			left[i] -= (float)(lights.strength[k] * lights.basis[k][i]);
	}
}
