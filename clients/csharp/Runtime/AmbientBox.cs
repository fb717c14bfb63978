// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>The room as a box: what it makes of the ambient light beside the probe (docs/users/conventions.md, "Ambient light at a place").</summary>
    internal static class AmbientBox
    {
        /// <summary>Directions in which the light is looked up.</summary>
        private const int Directions = 128;
        /// <summary>A place beyond a wall, or closer to it, is taken to be at this share of the way to it.</summary>
        private const double Within = 0.95;
        private const int MaxOrder = 4;

        private static readonly double[] Sphere = Fibonacci();
        private static readonly Table[] Tables = new Table[MaxOrder + 1];

        // SH as polynomials: m by m, (x + iy)^m times a polynomial in z, of its real part, then of its imaginary part, lowest power first.
        private const int Slots = 25;
        private static readonly int[] Starts = { 0, 5, 13, 19, 23 };
        private static readonly List<Term> Terms = AllTerms();

        /// <summary>What a coefficient of the SH adds to a coefficient of the polynomials.</summary>
        private struct Term
        {
            internal int Coefficient, Slot;
            internal double Factor;
        }

        /// <summary>
        /// Of an order: Y_i of the directions times 4π/n, coefficient by coefficient, and which SH the light in these directions has, by
        /// the SH of the light.
        /// </summary>
        private sealed class Table
        {
            internal readonly double[] Basis, Seen;

            internal Table(int order)
            {
                int count = (order + 1) * (order + 1);
                double weight = 4 * Math.PI / Directions;
                Basis = new double[(count + count % 2) * Directions]; // one more, of zeros, where their number is odd
                Seen = new double[count * count];
                for (int i = 0; i < count; i++)
                {
                    var polynomials = new double[Slots];
                    foreach (Term term in Terms)
                        if (term.Coefficient == i) polynomials[term.Slot] += term.Factor;
                    for (int k = 0; k < Directions; k++)
                        Basis[i * Directions + k] = weight * Value(polynomials, 0, new Powers(Sphere[3 * k], Sphere[3 * k + 1], Sphere[3 * k + 2]));
                }
                for (int i = 0; i < count; i++)
                    for (int j = 0; j < count; j++)
                        for (int k = 0; k < Directions; k++) Seen[i * count + j] += Basis[i * Directions + k] * Basis[j * Directions + k] / weight;
            }
        }

        /// <summary>Of a unit vector: its coordinates, and (x + iy)^m.</summary>
        private struct Powers
        {
            internal readonly double X, Y, Z, C2, S2, C3, S3, C4, S4;

            internal Powers(double x, double y, double z)
            {
                X = x;
                Y = y;
                Z = z;
                C2 = x * x - y * y;
                S2 = 2 * x * y;
                C3 = x * C2 - y * S2;
                S3 = x * S2 + y * C2;
                C4 = C2 * C2 - S2 * S2;
                S4 = 2 * C2 * S2;
            }
        }

        /// <summary>What the SH of a room's ambient light are at a place: metres from the probe, axes of the estimate's frame.</summary>
        internal static void Move(IList<float> coefficients, Room room, double x, double y, double z, List<float> there)
        {
            int order = (int)Math.Round(Math.Sqrt(coefficients.Count / 3)) - 1, count = (order + 1) * (order + 1);
            Table table = Tables[order] ?? (Tables[order] = new Table(order));
            double[] turn = Turn(room.Orientation), from = new double[3 * count];
            for (int i = 0; i < from.Length; i++) from[i] = coefficients[i];
            double[] seen = Look(Polynomials(from), room, turn, x, y, z), basis = table.Basis;
            for (int i = 0; i < count; i += 2)
            {
                double r = 0, g = 0, b = 0, nextR = 0, nextG = 0, nextB = 0; // two coefficients at a time: what is seen is read once
                for (int c = 0, at = i * Directions; c < seen.Length; c += 3, at++)
                {
                    double w = basis[at], next = basis[at + Directions], red = seen[c], green = seen[c + 1], blue = seen[c + 2];
                    r += w * red;
                    g += w * green;
                    b += w * blue;
                    nextR += next * red;
                    nextG += next * green;
                    nextB += next * blue;
                }
                Add(there, table, from, i, r, g, b);
                if (i + 1 < count) Add(there, table, from, i + 1, nextR, nextG, nextB);
            }
        }

        /// <summary>Coefficient i with its change: what the SH see there less what they see here.</summary>
        private static void Add(List<float> there, Table table, double[] from, int i, double r, double g, double b)
        {
            for (int c = 0, at = i * from.Length / 3; c < from.Length; c += 3, at++)
            {
                double w = table.Seen[at];
                r -= w * from[c];
                g -= w * from[c + 1];
                b -= w * from[c + 2];
            }
            there.Add((float)(from[3 * i] + r));
            there.Add((float)(from[3 * i + 1] + g));
            there.Add((float)(from[3 * i + 2] + b));
        }

        /// <summary>r, g, b of the light that comes to a place from each direction.</summary>
        private static double[] Look(double[] light, Room room, double[] turn, double x, double y, double z)
        {
            var seen = new double[3 * Directions];
            double xx = turn[0], xy = turn[1], xz = turn[2], yx = turn[3], yy = turn[4], yz = turn[5], zx = turn[6], zy = turn[7], zz = turn[8];
            double lowX = -room.WallsM[0], highX = room.WallsM[1], lowY = -room.WallsM[2], highY = room.WallsM[3], lowZ = -room.WallsM[4], highZ = room.WallsM[5];
            double px = Inside(xx * x + yx * y + zx * z, lowX, highX);
            double py = Inside(xy * x + yy * y + zy * z, lowY, highY);
            double pz = Inside(xz * x + yz * y + zz * z, lowZ, highZ);
            for (int c = 0; c < seen.Length; c += 3)
            {
                double dx = Sphere[c], dy = Sphere[c + 1], dz = Sphere[c + 2];
                double bx = xx * dx + yx * dy + zx * dz, by = xy * dx + yy * dy + zy * dz, bz = xz * dx + yz * dy + zz * dz;
                double t = Math.Min(WayM(bx, px, lowX, highX), Math.Min(WayM(by, py, lowY, highY), WayM(bz, pz, lowZ, highZ)));
                double hx = px + t * bx, hy = py + t * by, hz = pz + t * bz, share = 1 / Math.Sqrt(hx * hx + hy * hy + hz * hz);
                hx *= share;
                hy *= share;
                hz *= share;
                var powers = new Powers(xx * hx + xy * hy + xz * hz, yx * hx + yy * hy + yz * hz, zx * hx + zy * hy + zz * hz);
                seen[c] = Value(light, 0, powers);
                seen[c + 1] = Value(light, Slots, powers);
                seen[c + 2] = Value(light, 2 * Slots, powers);
            }
            return seen;
        }

        /// <summary>The polynomials of red, then of green, then of blue.</summary>
        private static double[] Polynomials(double[] coefficients)
        {
            var light = new double[3 * Slots];
            foreach (Term term in Terms)
                for (int c = 0; c < 3 && 3 * term.Coefficient < coefficients.Length; c++)
                    light[c * Slots + term.Slot] += term.Factor * coefficients[3 * term.Coefficient + c];
            return light;
        }

        private static double Value(double[] p, int o, in Powers d)
        {
            double z = d.Z;
            return p[o] + z * (p[o + 1] + z * (p[o + 2] + z * (p[o + 3] + z * p[o + 4])))
                + d.X * (p[o + 5] + z * (p[o + 6] + z * (p[o + 7] + z * p[o + 8]))) + d.Y * (p[o + 9] + z * (p[o + 10] + z * (p[o + 11] + z * p[o + 12])))
                + d.C2 * (p[o + 13] + z * (p[o + 14] + z * p[o + 15])) + d.S2 * (p[o + 16] + z * (p[o + 17] + z * p[o + 18]))
                + d.C3 * (p[o + 19] + z * p[o + 20]) + d.S3 * (p[o + 21] + z * p[o + 22]) + d.C4 * p[o + 23] + d.S4 * p[o + 24];
        }

        /// <summary>A coordinate of the place in the box's axes, within the walls.</summary>
        private static double Inside(double value, double low, double high) => Math.Max(Within * low, Math.Min(Within * high, value));

        /// <summary>How far it is along a ray to the walls across one axis.</summary>
        private static double WayM(double ray, double place, double low, double high) =>
            ray == 0 ? double.PositiveInfinity : ((ray > 0 ? high : low) - place) / ray;

        /// <summary>Row by row: turns the box's axes into the estimate's frame.</summary>
        private static double[] Turn(IList<float> xyzw)
        {
            double x = xyzw[0], y = xyzw[1], z = xyzw[2], w = xyzw[3], s = 2 / (x * x + y * y + z * z + w * w);
            return new[]
            {
                1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y), s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x),
                s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y),
            };
        }

        /// <summary>The recurrence of the associated Legendre functions without their sin^m (Sloan, JCGT 2013), for polynomials.</summary>
        private static List<Term> AllTerms()
        {
            var terms = new List<Term>();
            double diagonal = 1;
            for (int m = 0; m <= MaxOrder; m++, diagonal *= 2 * m - 1)
            {
                double[] before = new double[MaxOrder + 1], here = new double[MaxOrder + 1];
                here[0] = diagonal;
                for (int l = m; l <= MaxOrder; l++)
                {
                    var next = new double[MaxOrder + 1];
                    for (int power = 0; power <= l - m; power++)
                    {
                        double factor = Norm(l, m) * here[power];
                        int slot = Starts[m] + power, centre = l * (l + 1);
                        if (factor != 0) terms.Add(new Term { Coefficient = centre + m, Slot = slot, Factor = factor });
                        if (factor != 0 && m > 0) terms.Add(new Term { Coefficient = centre - m, Slot = slot + MaxOrder + 1 - m, Factor = factor });
                        if (power < MaxOrder) next[power + 1] += (2 * l + 1.0) / (l - m + 1) * here[power];
                        next[power] -= (l + m) / (l - m + 1.0) * before[power];
                    }
                    before = here;
                    here = next;
                }
            }
            return terms;
        }

        private static double Norm(int l, int m)
        {
            double ratio = 1;
            for (int k = l - m + 1; k <= l + m; k++) ratio /= k;
            return Math.Sqrt((2 * l + 1) / (4 * Math.PI) * ratio * (m > 0 ? 2 : 1));
        }

        /// <summary>x, y, z of directions that are spread evenly.</summary>
        private static double[] Fibonacci()
        {
            var sphere = new double[3 * Directions];
            for (int k = 0; k < Directions; k++)
            {
                double y = 1 - 2 * (k + 0.5) / Directions, ring = Math.Sqrt(1 - y * y), phi = Math.PI * (1 + Math.Sqrt(5)) * (k + 0.5);
                sphere[3 * k] = ring * Math.Cos(phi);
                sphere[3 * k + 1] = y;
                sphere[3 * k + 2] = ring * Math.Sin(phi);
            }
            return sphere;
        }
    }
}
