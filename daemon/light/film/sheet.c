/* SPDX-License-Identifier: Apache-2.0 */
#include "light/film/sheet.h"

#include <math.h>

/* Beyond 75 degrees off its normal a sheet is edge-on: cosine. */
#define LEAST_COSINE 0.2588F
/* A stack of three passes so little in places that no camera can tell how much; chosen by hand. */
#define LEAST_STACK 0.25F
/* Of half a turn, over which a mean is taken. */
#define MEAN_STEPS 16

/* ---------------------------------------------------------------- one ray */

static float dot(const float a[3], const float b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const float a[3], const float b[3], float product[3])
{
	product[0] = a[1] * b[2] - a[2] * b[1];
	product[1] = a[2] * b[0] - a[0] * b[2];
	product[2] = a[0] * b[1] - a[1] * b[0];
}

static float cosine_inside(float cosine, float index)
{
	return sqrtf(fmaxf(1.0F - (1.0F - cosine * cosine) / (index * index), 0.0F));
}

/* G, times that of the axis: |u|^4 / (1 - r^4). c, k: cosines outside and inside; w = (a d)^2. An
 * inner reflection leaves r of an amplitude, and there are two on the way to and fro. */
static float share(float c, float w, float index)
{
	const float n = index, k = cosine_inside(c, n);
	const float cos_apart = c * k + (1.0F - c * c) / n; /* cos(theta - theta') */
	const float sin_apart = k - c / n;		    /* sin(theta - theta') / sin theta */
	const float es2 = k * k * w / fmaxf(1.0F - w / (n * n), 1e-6F); /* e_s^2 sin^2 theta */
	const float tp = 4.0F * n * c * k / ((n * c + k) * (n * c + k));
	const float rp = (n * c - k) / (n * c + k), rs = (c - n * k) / (c + n * k);
	const float u2 = tp * (1.0F - es2 * sin_apart * sin_apart);
	/* rp e_p^2 - rs e_s^2, as rp + rs = 2 rs sin theta sin theta' / cos(theta - theta') */
	const float r = rp - 2.0F * rs * es2 / (n * cos_apart);

	return u2 * u2 / (1.0F - r * r * r * r);
}

static float gain_of(float cosine, float w, float index)
{
	if (cosine < LEAST_COSINE) { /* as there, at the same turn around the normal */
		w *= (1.0F - LEAST_COSINE * LEAST_COSINE) / (1.0F - cosine * cosine);
		cosine = LEAST_COSINE;
	}
	return share(cosine, w, index) / share(1.0F, 0.0F, index);
}

void lp_stokes_frame(const float direction[3], float right[3], float up[3])
{
	const float *d = direction;
	const float horizontal = hypotf(d[0], d[2]);
	const bool pole = horizontal < 1e-6F;

	right[0] = pole ? 1.0F : -d[2] / horizontal;
	right[1] = 0.0F;
	right[2] = pole ? 0.0F : d[0] / horizontal;
	up[0] = -right[2] * d[1];
	up[1] = right[2] * d[0] - right[0] * d[2];
	up[2] = right[0] * d[1];
}

/* cos 2 psi, sin 2 psi of u; c = n d > 0. */
static void axis_of(float index, const float n[3], const float a[3], const float direction[3],
		    float c, float axis[2])
{
	const float along = dot(a, direction);
	const float turned = (cosine_inside(c, index) - c / index) * along / index;
	float right[3], up[3], u[3], bent[3];

	cross(direction, a, u);
	cross(n, direction, bent);
	for (int i = 0; i < 3; i++)
		u[i] += turned * bent[i];
	lp_stokes_frame(direction, right, up);
	const float x = dot(u, right), y = dot(u, up);
	const float scale = 1.0F / fmaxf(x * x + y * y, 1e-12F);

	axis[0] = (x * x - y * y) * scale;
	axis[1] = 2.0F * x * y * scale;
}

/* ---------------------------------------------------------------- means, stacks */

static float cosine_of_step(int step)
{
	return LEAST_COSINE + (1.0F - LEAST_COSINE) * (float)step / (LP_FILM_STEPS - 1);
}

static void take_means(struct lp_film *film)
{
	for (int step = 0; step < LP_FILM_STEPS; step++) {
		const float cosine = cosine_of_step(step);
		double sum = 0.0, squares = 0.0;

		for (int k = 0; k < MEAN_STEPS; k++) {
			const double turn = sin(k * M_PI / MEAN_STEPS);
			const double w = turn * turn * (1.0 - (double)cosine * cosine);
			const double gain = gain_of(cosine, (float)w, film->index);

			sum += gain / MEAN_STEPS;
			squares += gain * gain / MEAN_STEPS;
		}
		film->mean[step] = (float)sum;
		film->deviation[step] = (float)(sqrt(fmax(squares - sum * sum, 0.0)) / sum);
	}
}

/* Light (S0, S1, S2) behind a sheet, t = 2. */
static void pass_sheet(const struct lp_film *film, const float n[3], const float a[3],
		       const float direction[3], float s[3])
{
	const float big = film->diattenuation, cosine = dot(n, direction);
	const float along = dot(a, direction), gain = gain_of(cosine, along * along, film->index);
	float axis[2];

	axis_of(film->index, n, a, direction, cosine, axis);
	const float x = axis[0], y = axis[1];
	const float with = x * s[1] + y * s[2], beside = x * s[2] - y * s[1];
	const float across = sqrtf(fmaxf(1.0F - big * big, 0.0F)) * beside;
	const float total = s[0] + big * with, through = big * s[0] + with;

	s[0] = gain * total;
	s[1] = gain * (x * through - y * across);
	s[2] = gain * (y * through + x * across);
}

/* Unpolarized light behind sheets at 90, 45 and 0 degrees, t = 2 each. n: towards the light; a,
 * quarter: across the last sheet's axis and the first one's. */
static float behind_stack(const struct lp_film *film, const float n[3], const float a[3],
			  const float quarter[3], const float direction[3])
{
	float s[3] = {1.0F, 0.0F, 0.0F};

	for (int deg = 90; deg >= 0; deg -= 45) {
		const double angle = deg * M_PI / 180.0;
		float turned[3];

		for (int i = 0; i < 3; i++)
			turned[i] = (float)(cos(angle) * a[i] + sin(angle) * quarter[i]);
		pass_sheet(film, n, turned, direction, s);
	}
	return s[0];
}

struct lp_film lp_film_of_one_sheet(float transmission, float extinction_ratio, float index)
{
	struct lp_film film = {.gain = transmission / 2.0F,
			       .diattenuation =
				       (extinction_ratio - 1.0F) / (extinction_ratio + 1.0F),
			       .index = index,
			       .sheet_count = 1};

	film.lens[0] = lp_rotation_identity();
	take_means(&film);
	return film;
}

/* A sheet passes k1 of light along its axis and k2 across it: a = k1 + k2, b = k1 - k2, c = 2
 * sqrt(k1 k2). Of S0 = 1 the first leaves S0 = a/2, S1 = -b/2 (it stands at 90 degrees); the one at
 * 45 degrees a/2 S0 and c/2 S1; of these the one at 0 degrees passes (a S0 + b S1) / 2. */
float lp_film_stack_gain(float transmission, float extinction_ratio)
{
	const float a = transmission, k2 = transmission / (extinction_ratio + 1.0F);
	const float b = a - 2.0F * k2, c = 2.0F * sqrtf(k2 * (a - k2));

	return (a * a * a - b * b * c) / 8.0F;
}

/* ---------------------------------------------------------------- views */

struct lp_film_view lp_film_seen(const struct lp_film *film, float wheel_deg,
				 const struct lp_rotation *to_frame)
{
	struct lp_film_view view = {.film = film, .angle_known = !isnan(wheel_deg)};
	const double angle_deg = view.angle_known ? (double)wheel_deg + film->offset_deg : 0.0;
	const double angle = angle_deg * M_PI / 180.0;
	/* n = -Z, p = (cos, sin, 0): n x p = (sin, -cos, 0) */
	const double normal[3] = {0.0, 0.0, -1.0}, across[3] = {sin(angle), -cos(angle), 0.0};

	for (int k = 0; k < film->sheet_count; k++) {
		const struct lp_rotation turn = lp_rotation_product(to_frame, &film->lens[k]);
		double n[3], a[3];

		lp_rotate(&turn, normal, n);
		lp_rotate(&turn, across, a);
		for (int i = 0; i < 3; i++) {
			view.normal[k][i] = (float)n[i];
			view.across[k][i] = (float)a[i];
		}
	}
	return view;
}

/* The sheet through which the direction is seen; *cosine: n d. */
static int sheet_of(const struct lp_film_view *view, const float direction[3], float *cosine)
{
	int sheet = 0;

	*cosine = dot(view->normal[0], direction);
	for (int k = 1; k < view->film->sheet_count; k++) {
		const float other = dot(view->normal[k], direction);

		if (other > *cosine) {
			*cosine = other;
			sheet = k;
		}
	}
	return sheet;
}

/* n: of the sheet, towards the light. */
static float stack_gain(const struct lp_film_view *view, int sheet, const float n[3],
			const float direction[3])
{
	const float *a = view->across[sheet];
	float quarter[3];

	cross(a, view->normal[sheet], quarter);
	return fmaxf(behind_stack(view->film, n, a, quarter, direction) /
			     behind_stack(view->film, n, a, quarter, n),
		     LEAST_STACK);
}

static void mean_pass(const struct lp_film *film, float cosine, struct lp_film_pass *pass)
{
	const float at = (fmaxf(cosine, LEAST_COSINE) - LEAST_COSINE) / (1.0F - LEAST_COSINE) *
			 (LP_FILM_STEPS - 1);
	const int step = at < LP_FILM_STEPS - 2 ? (int)at : LP_FILM_STEPS - 2;
	const float part = at - (float)step;

	pass->gain = film->mean[step] + part * (film->mean[step + 1] - film->mean[step]);
	pass->gain_sigma =
		film->deviation[step] + part * (film->deviation[step + 1] - film->deviation[step]);
}

struct lp_film_pass lp_film_pass(const struct lp_film_view *view, const float direction[3])
{
	struct lp_film_pass pass = {.gain = 1.0F};
	float signed_cosine, n[3];
	const int sheet = sheet_of(view, direction, &signed_cosine);
	const float cosine = fabsf(signed_cosine), *a = view->across[sheet];
	const float along = dot(a, direction);

	for (int i = 0; i < 3; i++)
		n[i] = signed_cosine < 0.0F ? -view->normal[sheet][i] : view->normal[sheet][i];
	if (view->film->is_stack) {
		pass.gain = stack_gain(view, sheet, n, direction);
		return pass;
	}
	if (!view->angle_known) {
		mean_pass(view->film, cosine, &pass);
		return pass;
	}
	pass.gain = gain_of(cosine, along * along, view->film->index);
	pass.polarizes = cosine >= LEAST_COSINE;
	axis_of(view->film->index, n, a, direction, cosine, pass.axis);
	for (int i = 0; i < 2; i++)
		pass.axis[i] *= view->film->diattenuation;
	return pass;
}

/* Along the plane of incidence Gs / Gp of it is read, across Gp / Gs, in between all: the amplitude
 * of that by its mean is 2 (Gp - Gs) / (Gp + Gs). */
void lp_film_turned(const struct lp_film_view *view, const float direction[3], float stokes[2])
{
	float right[3], up[3], across[3], signed_cosine;
	const int sheet = sheet_of(view, direction, &signed_cosine);
	const float cosine = fabsf(signed_cosine), index = view->film->index;
	const float s = gain_of(cosine, 1.0F - cosine * cosine, index);
	const float p = gain_of(cosine, 0.0F, index);

	cross(view->normal[sheet], direction, across);
	lp_stokes_frame(direction, right, up);
	const float x = dot(across, right), y = dot(across, up);
	const float dolp = 2.0F * (p - s) / (p + s) / fmaxf(x * x + y * y, 1e-12F);

	stokes[0] = dolp * (x * x - y * y);
	stokes[1] = dolp * 2.0F * x * y;
}
