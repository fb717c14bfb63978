/* SPDX-License-Identifier: Apache-2.0 */
#include "light/film/reflection.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define RAD ((float)M_PI / 180.0F)
#define REFRACTIVE_INDEX 1.5F

/* Chosen by hand: how likely each hypothesis is beforehand. What is
 * left is a lamp. */
#define PRIOR_POLARIZED 0.08F
#define PRIOR_FLOOR 0.10F
#define PRIOR_UPRIGHT 0.02F
/* Sigma of S1/S0 and S2/S0: of lamps, and of images (index, dirt). */
#define LAMP_SIGMA 0.03F
#define IMAGE_SIGMA 0.08F
/* Where a lamp is expected: the probe stands level, the mirror is flat. */
#define PLACE_SIGMA_RAD (1.5F * RAD)
/* Of the logarithm of the reflectance. */
#define REFLECTANCE_SIGMA 0.4F
/* Of a near lamp, the image is weaker than by reflectance alone, down to this share. */
#define LEAST_NEAR_SHARE 0.05F
/* Irradiances of two lamps of a scene lie within this factor. */
#define CONTRAST 1000.0F
/* An image lies beside its lamp, and further from it than this: pieces of a lamp are none. */
#define LEAST_APART_RAD (2.0F * RAD)
/* The arc from an image to its mirrored direction is longer than this, or it lies anyhow. */
#define LEAST_ARC_RAD (5.0F * RAD)
/* Probability from which on it is said. */
#define SURE 0.9F

struct lp_fresnel lp_fresnel(float cosine)
{
	const float n = REFRACTIVE_INDEX;
	const float inside = sqrtf(1.0F - (1.0F - cosine * cosine) / (n * n));
	const float across = (cosine - n * inside) / (cosine + n * inside);
	const float along = (n * cosine - inside) / (n * cosine + inside);
	const float s = across * across, p = along * along;

	return (struct lp_fresnel){.reflectance = (s + p) / 2.0F, .dolp = (s - p) / (s + p)};
}

/* ---------------------------------------------------------------- geometry */

static float dot(const float a[3], const float b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static bool unit(float v[3])
{
	const float length = sqrtf(dot(v, v));

	for (int i = 0; length > 1e-6F && i < 3; i++)
		v[i] /= length;
	return length > 1e-6F;
}

static void cross(const float a[3], const float b[3], float to[3])
{
	const float c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
			    a[0] * b[1] - a[1] * b[0]};

	memcpy(to, c, sizeof(c));
}

static float angle(const float a[3], const float b[3])
{
	float c[3];

	cross(a, b, c);
	return atan2f(sqrtf(dot(c, c)), dot(a, b));
}

/* Above the horizon. A unit vector may be rounded to more than 1. */
static float elevation(const float direction[3])
{
	return atan2f(direction[1], hypotf(direction[0], direction[2]));
}

/* An image in a mirror of normal m (towards the probe's side). */
struct mirror {
	float normal[3];
	float field[3];	   /* along which what is mirrored is polarized: m x d */
	float mirrored[3]; /* where a far lamp is */
	struct lp_fresnel fresnel;
};

static bool mirror_of(const float image[3], const float normal[3], struct mirror *mirror)
{
	const float cosine = -dot(normal, image);

	if (!(cosine > 0.02F)) /* grazing: no image can be told from its lamp */
		return false;
	for (int i = 0; i < 3; i++)
		mirror->mirrored[i] = image[i] + 2.0F * cosine * normal[i];
	memcpy(mirror->normal, normal, sizeof(mirror->normal));
	cross(normal, image, mirror->field);
	if (!unit(mirror->field)) { /* straight at it: not polarized */
		mirror->field[0] = 1.0F;
		mirror->field[1] = mirror->field[2] = 0.0F;
	}
	mirror->fresnel = lp_fresnel(cosine);
	return true;
}

/* Upright mirrors are told by the lamp: image, lamp and normal lie in one plane. */
static bool upright_mirror(const float image[3], const float lamp[3], struct mirror *mirror)
{
	const float up[3] = {0.0F, 1.0F, 0.0F};
	float plane[3], normal[3];

	cross(image, lamp, plane);
	if (!unit(plane))
		return false;
	cross(up, plane, normal);
	if (!unit(normal))
		return false;
	const float side = dot(normal, image) > 0.0F ? -1.0F : 1.0F;

	for (int i = 0; i < 3; i++)
		normal[i] *= side;
	return mirror_of(image, normal, mirror);
}

static float gauss(float x, float sigma)
{
	const float z = x / sigma;

	return expf(-z * z / 2.0F) / (sqrtf(2.0F * (float)M_PI) * sigma);
}

/* A lamp that is near, beside the arc from its image to the mirrored direction. */
struct near_lamp {
	float length, beside; /* of the arc; radians */
	float share;	      /* squared: how much nearer the lamp is than its image. NAN: either */
};

/* Lamp and image are equally far from the line through the probe across the mirror, so that the
 * lamp is nearer than its image by the sines of their angles from it. Of a much nearer one the
 * image were too weak: it would stand right beside the probe. */
static bool may_be_near(const float image[3], const struct mirror *mirror, const float lamp[3],
			float *share)
{
	float across_image[3], across_lamp[3];

	cross(mirror->normal, image, across_image);
	cross(mirror->normal, lamp, across_lamp);
	const float of_image = sqrtf(dot(across_image, across_image)),
		    of_lamp = sqrtf(dot(across_lamp, across_lamp)), off = 2.0F * PLACE_SIGMA_RAD;
	const float most = (of_image + off) / fmaxf(of_lamp, off);
	const bool tells = fminf(of_image, of_lamp) > 2.0F * off;
	const float nearer = fminf(of_image / fmaxf(of_lamp, off), 1.0F);

	*share = tells ? nearer * nearer : NAN;
	return most * most > LEAST_NEAR_SHARE;
}

static bool on_arc(const struct lp_suspect *suspect, const struct mirror *mirror,
		   const struct lp_suspect *of, struct near_lamp *near)
{
	const float *image = suspect->direction, *lamp = of->direction;
	const float apart = fmaxf((suspect->radius_deg + of->radius_deg) * RAD, LEAST_APART_RAD);
	float plane[3], to_lamp[3];

	cross(image, mirror->mirrored, plane);
	near->length = angle(image, mirror->mirrored);
	if (!unit(plane) || near->length < LEAST_ARC_RAD)
		return false;
	cross(image, lamp, to_lamp);
	const float sine = dot(plane, lamp);
	const float along = atan2f(dot(to_lamp, plane), dot(image, lamp));

	near->beside = asinf(fmaxf(fminf(sine, 1.0F), -1.0F));
	return along > apart && along < near->length + 2.0F * PLACE_SIGMA_RAD &&
	       may_be_near(image, mirror, lamp, &near->share);
}

/* ---------------------------------------------------------------- likelihoods */

/* All of them relative to a lamp that stands anywhere with any strength. */

/* Probability that the logarithm of a strength is less than what is so far above the expected. */
static float less(float above)
{
	return 0.5F * erfcf(-above / (sqrtf(2.0F) * REFLECTANCE_SIGMA));
}

/* excess: logarithm of how much stronger an image is than reflectance alone has it. near NULL: of a
 * far lamp. A near one shines the same to all sides, or less towards the mirror. */
static float strength_density(float excess, const struct near_lamp *near)
{
	if (!near)
		return gauss(excess, REFLECTANCE_SIGMA);
	const float span = -logf(LEAST_NEAR_SHARE);
	const float any = (less(-excess) - less(-excess - span)) / span;

	return isnan(near->share)
		       ? any
		       : (gauss(excess - logf(near->share), REFLECTANCE_SIGMA) + any) / 2.0F;
}

/* One of them clips, or both: whether the image may be as strong as the reflectance says, or, of a
 * near lamp, weaker. A lamp that clips is stronger than it seems, and so is an image. */
static float bound_probability(float excess, const struct lp_suspect *image,
			       const struct lp_suspect *lamp, bool far)
{
	if (lamp->is_bound)
		return image->is_bound ? 1.0F
				       : less(far ? excess : excess - logf(LEAST_NEAR_SHARE));
	return 1.0F - less(excess);
}

static float log_strength(const struct lp_suspect *suspect)
{
	return logf(fmaxf(suspect->irradiance, FLT_MIN));
}

static float strength_ratio(const struct lp_suspect *image, const struct lp_suspect *lamp,
			    const struct lp_fresnel *fresnel, const struct near_lamp *near)
{
	const float any = 1.0F / logf(CONTRAST), dolp = fresnel->dolp;
	const float excess = log_strength(image) - log_strength(lamp) - logf(fresnel->reflectance);
	/* What the film makes of light whose polarization is not known. */
	const float passed[] = {1.0F, 1.0F + dolp, 1.0F - 0.9F * dolp};
	const int ways = image->polarization.known ? 1 : 3;
	float ratio = 0.0F;

	for (int k = 0; k < ways; k++) {
		const float above = excess - logf(passed[k]);

		ratio += image->is_bound || lamp->is_bound
				 ? bound_probability(above, image, lamp, !near)
				 : strength_density(above, near) / any;
	}
	return ratio / (float)ways;
}

/* The lamp is where an image in a floor says; far and near lamps are as likely. */
static float floor_ratio(const struct lp_suspect *image, const struct lp_suspect *lamp,
			 const struct mirror *mirror)
{
	const float sphere = 4.0F * (float)M_PI;
	const float off = angle(mirror->mirrored, lamp->direction);
	const float z = off / PLACE_SIGMA_RAD;
	const float far = 2.0F / (PLACE_SIGMA_RAD * PLACE_SIGMA_RAD) * expf(-z * z / 2.0F);
	struct near_lamp near;
	float ratio = 0.5F * far * strength_ratio(image, lamp, &mirror->fresnel, NULL);

	if (on_arc(image, mirror, lamp, &near))
		ratio += 0.5F * sphere / near.length * gauss(near.beside, PLACE_SIGMA_RAD) *
			 strength_ratio(image, lamp, &mirror->fresnel, &near);
	return ratio;
}

/* The same of an upright mirror that may face any way: a far lamp is as high as its image, a near
 * one higher above or deeper below the horizon. */
static float upright_ratio(const struct lp_suspect *image, const struct lp_suspect *lamp,
			   const struct mirror *mirror)
{
	const float off = elevation(lamp->direction) - elevation(image->direction);
	const float far = 2.0F * gauss(off, PLACE_SIGMA_RAD);
	struct near_lamp near;

	if (!on_arc(image, mirror, lamp, &near))
		return 0.0F;
	return 0.5F * far * strength_ratio(image, lamp, &mirror->fresnel, NULL) +
	       0.5F * strength_ratio(image, lamp, &mirror->fresnel, &near);
}

/* Probability density of the polarization found, if it is expected to be q, u with `sigma`. */
static float polarization_density(const struct lp_polarization *p, float q, float u, float sigma)
{
	const float xx = p->qq + sigma * sigma, yy = p->uu + sigma * sigma, xy = p->qu;
	const float determinant = xx * yy - xy * xy;
	const float dq = p->q - q, du = p->u - u;
	const float distance = (yy * dq * dq - 2.0F * xy * dq * du + xx * du * du) / determinant;

	return expf(-distance / 2.0F) / (2.0F * (float)M_PI * sqrtf(determinant));
}

/* What is mirrored is polarized as Fresnel says, or less, by light from beneath the surface. */
static float image_density(const struct lp_suspect *image, const struct mirror *mirror)
{
	static const struct {
		float share, weight;
	} parts[] = {{1.0F, 0.6F}, {0.8F, 0.25F}, {0.6F, 0.15F}};
	const float *field = mirror->field;
	float right[3], up[3], density = 0.0F;

	lp_stokes_frame(image->direction, right, up);
	const float x = dot(field, right), y = dot(field, up);

	for (int k = 0; k < 3; k++) {
		const float dolp = parts[k].share * mirror->fresnel.dolp;

		density += parts[k].weight * polarization_density(&image->polarization,
								  dolp * (x * x - y * y),
								  dolp * 2.0F * x * y, IMAGE_SIGMA);
	}
	return density;
}

/* Images are no larger than their lamps, but for a rough surface. */
static bool has_size(const struct lp_suspect *image, const struct lp_suspect *lamp, float factor,
		     float margin_deg)
{
	return image->radius_deg < factor * lamp->radius_deg + margin_deg;
}

/* Likelihood that a suspect is the image of a lamp, by the two kinds of mirrors. */
static float likelihood(const struct lp_suspect *image, const struct lp_suspect *lamp, bool upright)
{
	static const float up[3] = {0.0F, 1.0F, 0.0F};
	const bool known = image->polarization.known;
	struct mirror mirror;
	float ratio;

	if (upright && !has_size(image, lamp, 2.0F, 1.5F))
		return 0.0F;
	if (!has_size(image, lamp, 4.0F, 3.0F))
		return 0.0F;
	if (upright ? !upright_mirror(image->direction, lamp->direction, &mirror)
		    : !mirror_of(image->direction, up, &mirror))
		return 0.0F;
	ratio = upright ? upright_ratio(image, lamp, &mirror) : floor_ratio(image, lamp, &mirror);
	return known ? ratio * image_density(image, &mirror) : ratio;
}

/* Among the stronger ones, and those of which it is not known. */
static struct lp_verdict judge(const struct lp_suspect *suspects, int count, int at,
			       const struct lp_verdict *verdicts)
{
	const struct lp_suspect *s = &suspects[at];
	const bool known = s->polarization.known;
	float image = 0.0F;
	int lamps = 0;

	for (int k = 0; k < count; k++) {
		if (k == at || (k > at && !suspects[k].is_bound) ||
		    verdicts[k].kind == LP_CLASS_REFLECTION)
			continue;
		lamps++;
		image += PRIOR_FLOOR * likelihood(s, &suspects[k], false) +
			 PRIOR_UPRIGHT * likelihood(s, &suspects[k], true);
	}
	if (lamps)
		image /= (float)lamps;
	const float lamp =
		(1.0F - PRIOR_FLOOR - PRIOR_UPRIGHT - PRIOR_POLARIZED) *
		(known ? polarization_density(&s->polarization, 0.0F, 0.0F, LAMP_SIGMA) : 1.0F);
	const float polarized = PRIOR_POLARIZED * (known ? 1.0F / (float)M_PI : 1.0F);
	const float all = image + lamp + polarized;
	struct lp_verdict verdict = {.kind = LP_CLASS_UNSURE, .reflection = image / all};

	if (verdict.reflection > SURE)
		verdict.kind = LP_CLASS_REFLECTION;
	else if (known && lamp / all > SURE)
		verdict.kind = LP_CLASS_LAMP;
	return verdict;
}

void lp_tell_reflections(const struct lp_suspect *suspects, int count, struct lp_verdict *verdicts)
{
	for (int k = 0; k < count; k++)
		verdicts[k].kind = LP_CLASS_UNSURE;
	for (int k = 0; k < count; k++)
		verdicts[k] = judge(suspects, count, k, verdicts);
}

double lp_film_turned_evidence(const struct lp_suspect *suspects, int count)
{
	static const float up[3] = {0.0F, 1.0F, 0.0F};
	double evidence = 1.0;

	for (int k = 1; k < count; k++) {
		struct lp_suspect turned = suspects[k];
		struct mirror mirror;
		float as_is = 0.0F, if_turned = 0.0F;

		if (!turned.polarization.known || !mirror_of(suspects[k].direction, up, &mirror))
			continue;
		turned.polarization.q = -turned.polarization.q;
		turned.polarization.u = -turned.polarization.u;
		for (int j = 0; j < k; j++) {
			as_is += likelihood(&suspects[k], &suspects[j], false);
			if_turned += likelihood(&turned, &suspects[j], false);
		}
		const float other = (float)k / (float)M_PI;

		evidence *= (double)(if_turned + other) / (double)(as_is + other);
	}
	return evidence;
}
