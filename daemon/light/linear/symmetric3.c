/* SPDX-License-Identifier: Apache-2.0 */
#include "light/linear/symmetric3.h"

#include <math.h>

#define SWEEPS 8 /* converges quadratically: 4 suffice in double */

/* Annihilate a[p][q] by a rotation in the (p, q) plane (Golub & Van Loan, section 8.5). */
static void rotate(double a[3][3], double v[3][3], int p, int q)
{
	if (a[p][q] == 0.0)
		return;

	const double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
	const double t = (theta >= 0.0 ? 1.0 : -1.0) / (fabs(theta) + hypot(theta, 1.0));
	const double c = 1.0 / hypot(t, 1.0), s = t * c;

	for (int k = 0; k < 3; k++) {
		const double kp = a[k][p], kq = a[k][q];

		a[k][p] = c * kp - s * kq;
		a[k][q] = s * kp + c * kq;
	}
	for (int k = 0; k < 3; k++) {
		const double pk = a[p][k], qk = a[q][k];
		const double vp = v[k][p], vq = v[k][q];

		a[p][k] = c * pk - s * qk;
		a[q][k] = s * pk + c * qk;
		v[k][p] = c * vp - s * vq;
		v[k][q] = s * vp + c * vq;
	}
}

double lp_symmetric3_largest(const double matrix[6], double vector[3])
{
	double a[3][3] = {{matrix[0], matrix[1], matrix[2]},
			  {matrix[1], matrix[3], matrix[4]},
			  {matrix[2], matrix[4], matrix[5]}};
	double v[3][3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
	int largest = 0;

	for (int sweep = 0; sweep < SWEEPS; sweep++) {
		rotate(a, v, 0, 1);
		rotate(a, v, 0, 2);
		rotate(a, v, 1, 2);
	}
	for (int k = 1; k < 3; k++)
		if (a[k][k] > a[largest][largest])
			largest = k;
	for (int k = 0; k < 3; k++)
		vector[k] = v[k][largest];
	return a[largest][largest];
}
