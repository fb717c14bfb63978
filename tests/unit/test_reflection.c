/* SPDX-License-Identifier: Apache-2.0 */
/* Lamps, their mirror images, and light that is polarized by itself. */
#include "light/film/reflection.h"

#include <math.h>

#include "lp_test.h"

#define RAD ((float)M_PI / 180.0F)

static struct lp_suspect at(float azimuth_deg, float elevation_deg, float irradiance)
{
	const float a = azimuth_deg * RAD, e = elevation_deg * RAD;

	return (struct lp_suspect){
		.direction = {cosf(e) * sinf(a), sinf(e), -cosf(e) * cosf(a)},
		.irradiance = irradiance,
		.radius_deg = 2.0F,
		.polarization = {.s0 = irradiance, .qq = 4e-4F, .uu = 4e-4F, .known = true}};
}

static struct lp_suspect polarized(struct lp_suspect s, float q, float u)
{
	s.polarization.q = q;
	s.polarization.u = u;
	return s;
}

static struct lp_suspect unknown(struct lp_suspect s)
{
	s.polarization.known = false;
	return s;
}

/* The image of a far lamp at the same azimuth, in a polished floor. */
static struct lp_suspect image(float azimuth_deg, float elevation_deg, float irradiance)
{
	const struct lp_fresnel f = lp_fresnel(sinf(elevation_deg * RAD));

	return polarized(at(azimuth_deg, -elevation_deg, irradiance * f.reflectance), f.dolp, 0.0F);
}

/* Image of a lamp at a place in metres, in a wall whose normal points to an azimuth, so far away.
 */
static struct lp_suspect in_a_wall(const float lamp[3], float irradiance, float normal_deg,
				   float away_m)
{
	const float a = normal_deg * RAD, normal[3] = {sinf(a), 0.0F, -cosf(a)};
	const float before = 2.0F * (lamp[0] * normal[0] + lamp[2] * normal[2] + away_m);
	const float place[3] = {lamp[0] - before * normal[0], lamp[1],
				lamp[2] - before * normal[2]};
	const float near = hypotf(hypotf(lamp[0], lamp[1]), lamp[2]);
	const float far = hypotf(hypotf(place[0], place[1]), place[2]);
	struct lp_suspect shown = at(0, 0, 1.0F);
	float right[3], up[3], *d = shown.direction;

	for (int i = 0; i < 3; i++)
		d[i] = place[i] / far;
	const struct lp_fresnel f = lp_fresnel(-(d[0] * normal[0] + d[2] * normal[2]));
	/* across the plane of incidence: normal x d */
	const float field[3] = {-normal[2] * d[1], normal[2] * d[0] - normal[0] * d[2],
				normal[0] * d[1]};

	lp_stokes_frame(d, right, up);
	const float x = field[0] * right[0] + field[1] * right[1] + field[2] * right[2];
	const float y = field[0] * up[0] + field[1] * up[1] + field[2] * up[2];
	const float over = f.dolp / (x * x + y * y);

	shown.irradiance = irradiance * f.reflectance * near * near / (far * far);
	return polarized(shown, over * (x * x - y * y), over * 2.0F * x * y);
}

static struct lp_verdict second(struct lp_suspect a, struct lp_suspect b)
{
	struct lp_verdict verdicts[2];

	lp_tell_reflections((const struct lp_suspect[]){a, b}, 2, verdicts);
	assert_int_not_equal(verdicts[0].kind, LP_CLASS_REFLECTION);
	return verdicts[1];
}

static void test_fresnel(void **state)
{
	const struct lp_fresnel straight = lp_fresnel(1.0F), brewster = lp_fresnel(0.5547F),
				grazing = lp_fresnel(0.0F);

	(void)state;
	assert_float_equal(straight.reflectance, 0.04, 1e-6); /* ((n - 1) / (n + 1))^2 */
	assert_float_equal(straight.dolp, 0.0, 1e-6);
	assert_float_equal(brewster.dolp, 1.0, 1e-4); /* atan n = 56.31 degrees */
	assert_float_equal(brewster.reflectance, 0.0739645, 1e-5);
	assert_float_equal(grazing.reflectance, 1.0, 1e-6);
}

static void test_images_in_a_floor(void **state)
{
	(void)state;
	for (int elevation = 8; elevation <= 80; elevation += 4)
		for (int azimuth = -180; azimuth < 180; azimuth += 50) {
			const float a = (float)azimuth, e = (float)elevation;
			const struct lp_verdict v = second(at(a, e, 10.0F), image(a, e, 10.0F));

			assert_int_equal(v.kind, LP_CLASS_REFLECTION);
			assert_true(v.reflection > 0.9F);
		}
}

/* A lamp 1 m above the probe and 2 m away, the probe 1 m above the floor. */
static void test_an_image_in_a_near_floor(void **state)
{
	const float lamp_deg = atan2f(1.0F, 2.0F) / RAD, image_deg = atan2f(3.0F, 2.0F) / RAD;
	const float nearer = 5.0F / 13.0F; /* squared distances */

	(void)state;
	assert_int_equal(second(at(30, lamp_deg, 10.0F), image(30, image_deg, 10.0F * nearer)).kind,
			 LP_CLASS_REFLECTION);
}

/* A lamp that stands on the floor, right beside its image; but not what lies within a lamp. */
static void test_an_image_at_the_foot_of_its_lamp(void **state)
{
	struct lp_suspect lamp = at(30, -40, 10.0F), shown = image(30, 45, 10.0F);

	(void)state;
	lamp.radius_deg = 1.7F;
	shown.radius_deg = 1.6F;
	assert_int_equal(second(lamp, shown).kind, LP_CLASS_REFLECTION);
	lamp.radius_deg = 6.0F;
	assert_int_not_equal(second(lamp, shown).kind, LP_CLASS_REFLECTION);
}

/* Near the nadir, and where the sheet is edge-on, the place and the strength tell. */
static void test_images_whose_polarization_says_nothing(void **state)
{
	(void)state;
	assert_int_equal(second(at(90, 40, 10.0F), unknown(image(90, 40, 10.0F))).kind,
			 LP_CLASS_REFLECTION);
	assert_int_equal(second(at(10, 85, 10.0F), image(10, 85, 10.0F)).kind, LP_CLASS_REFLECTION);
	/* as strong as the other, it is no image */
	assert_int_not_equal(second(at(90, 40, 10.0F), unknown(at(90, -40, 9.0F))).kind,
			     LP_CLASS_REFLECTION);
}

/* Of an image whose polarization is not known, the film may have passed nearly all or little. */
static void test_an_image_that_the_film_made_brighter_or_darker(void **state)
{
	const float factors[] = {0.3F, 1.0F, 1.8F};

	(void)state;
	for (int k = 0; k < 3; k++) {
		struct lp_suspect seen = unknown(image(90, 25, 10.0F));

		seen.irradiance *= factors[k];
		assert_true(second(at(90, 25, 10.0F), seen).reflection > 0.9F);
	}
	/* a lamp on the floor, hardly nearer than its image */
	assert_true(second(at(90, -3, 3.0F), unknown(at(90, -22, 0.7F))).reflection > 0.5F);
}

/* Near lamps: the place tells how much further away the image is, and so how strong. */
static void test_how_strong_the_image_of_a_near_lamp_is(void **state)
{
	const float place[] = {1.2F, 0.9F, -1.2F};
	struct lp_suspect lamp = at(45, 27.9F, 10.0F), seen = in_a_wall(place, 10.0F, -80, 1.5F);

	(void)state;
	const float as_it_is = second(lamp, seen).reflection;
	struct lp_suspect weaker = seen;

	weaker.irradiance /= 4.0F;
	seen.irradiance *= 4.0F;
	assert_true(as_it_is > 0.9F);
	assert_true(second(lamp, weaker).reflection < 0.9F); /* of a lamp that shines elsewhere */
	assert_true(second(lamp, seen).reflection < 0.7F);
}

static struct lp_suspect clipped(struct lp_suspect s, float left)
{
	s.irradiance *= left;
	s.is_bound = true;
	return s;
}

/* Of lamps that clip only the least strength is known: the place, and what can still be said. */
static void test_images_of_lamps_that_clip(void **state)
{
	const struct lp_suspect lamp = at(90, 40, 10.0F), shown = unknown(image(90, 40, 10.0F));
	struct lp_verdict verdicts[2];

	(void)state;
	assert_int_equal(second(clipped(lamp, 0.1F), shown).kind, LP_CLASS_REFLECTION);
	assert_int_equal(second(clipped(lamp, 0.1F), clipped(shown, 0.5F)).kind,
			 LP_CLASS_REFLECTION);
	/* both clip, and the image seems to be the stronger one */
	lp_tell_reflections((const struct lp_suspect[]){shown, clipped(lamp, 0.01F)}, 2, verdicts);
	assert_int_equal(verdicts[0].kind, LP_CLASS_REFLECTION);
	assert_int_not_equal(verdicts[1].kind, LP_CLASS_REFLECTION);
	/* even the least strength of the lamp is too much for it, as near as it may be, and
	 * whatever the film leaves of the image */
	assert_true(second(clipped(lamp, 0.1F), unknown(at(90, -40, 1e-4F))).reflection < 0.1F);
	/* it is stronger than an image of this lamp could be */
	assert_int_not_equal(second(lamp, clipped(unknown(at(90, -40, 10.0F)), 0.5F)).kind,
			     LP_CLASS_REFLECTION);
	/* not where an image would be */
	for (int azimuth = 20; azimuth < 340; azimuth += 20)
		assert_int_not_equal(second(clipped(at(0, 50, 10.0F), 0.1F),
					    clipped(unknown(at((float)azimuth, -50, 3.0F)), 0.1F))
					     .kind,
				     LP_CLASS_REFLECTION);
}

/* Straight below and level with the probe: as lamp and image, they would stand a hand's breadth
 * beside it. */
static void test_a_clipped_lamp_at_the_nadir_is_nobodys_image(void **state)
{
	(void)state;
	for (int elevation = -10; elevation <= 40; elevation += 5) {
		const struct lp_suspect lamp = clipped(at(0, (float)elevation, 10.0F), 0.1F);
		const struct lp_suspect below = clipped(unknown(at(0, -89.5F, 10.0F)), 0.08F);

		assert_true(second(lamp, below).reflection < 0.05F);
	}
	/* straight above it, it may be the lamp */
	assert_int_equal(second(clipped(at(0, 89.5F, 10.0F), 0.1F),
				clipped(unknown(at(0, -89.5F, 10.0F)), 0.08F))
				 .kind,
			 LP_CLASS_REFLECTION);
}

static void test_lamps_are_lamps(void **state)
{
	(void)state;
	for (int elevation = -80; elevation <= 80; elevation += 10)
		for (int azimuth = 20; azimuth < 340; azimuth += 20) {
			const struct lp_suspect lamp = at((float)azimuth, (float)elevation, 3.0F);
			const struct lp_verdict v = second(at(0, 50, 10.0F), lamp);

			assert_int_equal(v.kind, LP_CLASS_LAMP);
			assert_true(v.reflection < 0.1F);
			/* not known: no lamp for certain, but by no means an image */
			assert_int_not_equal(second(at(0, 50, 10.0F), unknown(lamp)).kind,
					     LP_CLASS_REFLECTION);
		}
	/* below another lamp, too */
	assert_int_not_equal(second(at(0, 50, 10.0F), at(0, -30, 3.0F)).kind, LP_CLASS_REFLECTION);
}

/* Lamps 2 m away; walls that face all ways, near Brewster's angle or not far from it. */
static void test_walls_may_face_any_way(void **state)
{
	int shown = 0;

	(void)state;
	for (int normal_deg = -180; normal_deg < 180; normal_deg += 10)
		for (int aside_deg = -80; aside_deg <= 80; aside_deg += 8) {
			const float azimuth = (float)(normal_deg + aside_deg);
			const struct lp_suspect lamp = at(azimuth, 25, 10.0F);
			const float place[3] = {2.0F * lamp.direction[0], 2.0F * lamp.direction[1],
						2.0F * lamp.direction[2]};
			const struct lp_suspect seen =
				in_a_wall(place, 10.0F, (float)normal_deg, 0.5F);
			const float dolp = hypotf(seen.polarization.q, seen.polarization.u);

			if (dolp < 0.4F)
				continue;
			shown++;
			assert_int_equal(second(lamp, seen).kind, LP_CLASS_REFLECTION);
		}
	assert_true(shown > 100);
}

/* A window or a picture on the wall mirrors a lamp: polarized upright, or nearly. */
static void test_images_in_upright_mirrors(void **state)
{
	/* wall across +X; lamp and image are equally high */
	const float e = 20.0F * RAD, a = 50.0F * RAD;
	const struct lp_suspect lamp = at(-50, 20, 10.0F);
	struct lp_suspect shown = at(50, 20, 1.0F);
	const float cosine = cosf(e) * sinf(a);
	const struct lp_fresnel f = lp_fresnel(cosine);
	/* across the plane of incidence: m x d, m = -X */
	const float *d = shown.direction;
	const float field[3] = {0.0F, d[2], -d[1]};
	const float length = hypotf(field[1], field[2]);
	float right[3], up[3];

	(void)state;
	lp_stokes_frame(d, right, up);
	const float x = (field[1] * right[1] + field[2] * right[2]) / length,
		    y = (field[1] * up[1] + field[2] * up[2]) / length;

	shown.irradiance = 10.0F * f.reflectance;
	shown = polarized(shown, f.dolp * (x * x - y * y), f.dolp * 2.0F * x * y);
	assert_int_equal(second(lamp, shown).kind, LP_CLASS_REFLECTION);
	assert_int_equal(second(lamp, polarized(shown, 0.0F, 0.0F)).kind, LP_CLASS_LAMP);
	/* not known: an upright mirror may face any way, so nothing is sure */
	const struct lp_verdict unsure = second(lamp, unknown(shown));

	assert_int_equal(unsure.kind, LP_CLASS_UNSURE);
	assert_true(unsure.reflection > 0.1F);
}

/* Sky and screens are polarized without being anybody's image. */
static void test_light_that_is_polarized_by_itself(void **state)
{
	const float angles_deg[] = {0, 30, 45, 60, 90, 135};
	struct lp_suspect sky = at(110, 40, 2.0F);

	(void)state;
	for (int k = 0; k < 6; k++) {
		const float q = cosf(2.0F * angles_deg[k] * RAD),
			    u = sinf(2.0F * angles_deg[k] * RAD);

		for (int azimuth = 30; azimuth <= 330; azimuth += 60) {
			const struct lp_suspect screen =
				polarized(at((float)azimuth, -15, 1.0F), 0.98F * q, 0.98F * u);

			assert_int_equal(second(at(0, 50, 10.0F), screen).kind, LP_CLASS_UNSURE);
		}
	}
	sky.radius_deg = 12.0F; /* 90 degrees from a sun of 0.27 degrees */
	sky = polarized(sky, 0.5F, 0.5F);
	struct lp_suspect sun = at(0, 35, 25.0F);

	sun.radius_deg = 0.27F;
	assert_int_equal(second(sun, sky).kind, LP_CLASS_UNSURE);
}

/* The image of an image is none, and an image does not explain a lamp. */
static void test_several(void **state)
{
	const struct lp_suspect all[] = {at(0, 50, 10.0F),     at(100, 20, 8.0F),
					 image(100, 20, 8.0F), at(40, 10, 0.9F),
					 image(0, 50, 10.0F),  at(-100, -30, 0.4F)};
	const enum lp_lamp_class expected[] = {LP_CLASS_LAMP,	    LP_CLASS_LAMP,
					       LP_CLASS_REFLECTION, LP_CLASS_LAMP,
					       LP_CLASS_REFLECTION, LP_CLASS_LAMP};
	struct lp_verdict verdicts[6];

	(void)state;
	lp_tell_reflections(all, 6, verdicts);
	for (int k = 0; k < 6; k++)
		assert_int_equal(verdicts[k].kind, expected[k]);
	assert_true(lp_film_turned_evidence(all, 6) < 1.0);
}

/* Put in a quarter turn wrong, the film makes floors upright. Nothing is then called an image by
 * its polarization, and it is found. */
static void test_a_film_put_in_wrong(void **state)
{
	struct lp_suspect all[] = {at(0, 50, 10.0F), at(100, 20, 8.0F), image(100, 20, 8.0F),
				   image(0, 50, 10.0F)};
	struct lp_verdict verdicts[4];

	(void)state;
	for (int k = 2; k < 4; k++)
		all[k].polarization.q = -all[k].polarization.q;
	lp_tell_reflections(all, 4, verdicts);
	assert_int_equal(verdicts[2].kind, LP_CLASS_UNSURE);
	assert_int_equal(verdicts[3].kind, LP_CLASS_UNSURE);
	assert_true(lp_film_turned_evidence(all, 4) > 1e3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_fresnel),
		cmocka_unit_test(test_images_in_a_floor),
		cmocka_unit_test(test_an_image_in_a_near_floor),
		cmocka_unit_test(test_an_image_at_the_foot_of_its_lamp),
		cmocka_unit_test(test_images_whose_polarization_says_nothing),
		cmocka_unit_test(test_an_image_that_the_film_made_brighter_or_darker),
		cmocka_unit_test(test_how_strong_the_image_of_a_near_lamp_is),
		cmocka_unit_test(test_images_of_lamps_that_clip),
		cmocka_unit_test(test_a_clipped_lamp_at_the_nadir_is_nobodys_image),
		cmocka_unit_test(test_lamps_are_lamps),
		cmocka_unit_test(test_walls_may_face_any_way),
		cmocka_unit_test(test_images_in_upright_mirrors),
		cmocka_unit_test(test_light_that_is_polarized_by_itself),
		cmocka_unit_test(test_several),
		cmocka_unit_test(test_a_film_put_in_wrong),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
