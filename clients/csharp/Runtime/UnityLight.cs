// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>Which renderer a light is for: they differ in what a light's intensity means.</summary>
    public enum Pipeline
    {
        /// <summary>Built-in and URP: a white surface that faces a light of intensity 1 shows 1. No division by π.</summary>
        Universal,
        /// <summary>HDRP: the intensity of a directional light is in lux.</summary>
        HighDefinition,
    }

    /// <summary>
    /// A probe's light as Unity has it. Unity's axes are left-handed: z is turned round. Numbers are the same as those of
    /// `unity` and `unity-hdrp` in lightprobe.convert (Python), with which tests compare them.
    /// </summary>
    public sealed class UnityLight
    {
        /// <summary>Constants K of the basis polynomials times A/π: Unity's shaders know the polynomials alone.</summary>
        private static readonly double[] Scale = ShaderScale();
        private static readonly double[] Sign = { 1, 1, -1, 1, 1, -1, 1, -1, 1 };

        /// <summary>Unit vector along which the light travels, Unity's axes: forward of the transform.</summary>
        public readonly float[] Forward;
        /// <summary>Red, green, blue, the largest of them 1; as sRGB, which Unity's Color of a light is.</summary>
        public readonly float[] Colour;
        /// <summary>As the pipeline wants it: see <see cref="Pipeline"/>.</summary>
        public readonly float Intensity;
        /// <summary>Angular diameter in degrees, for soft shadows.</summary>
        public readonly float AngularDiameterDeg;
        /// <summary>False of a mirror image: it shines through the floor or pane in which it is seen.</summary>
        public readonly bool CastsShadow;
        /// <summary>
        /// Share, 0 to 1, of the light on a surface that faces up: how dark a shadow is that you draw on a table yourself. Null:
        /// not known. Leave Unity's Light.shadowStrength at 1: its renderer takes the lamp's light away, and the rest remains.
        /// </summary>
        public readonly float? ShadowStrength;

        /// <param name="lamp">A lamp of an estimate.</param>
        /// <param name="pipeline">Which renderer it is for.</param>
        /// <param name="cdM2PerUnit">Luminance of radiance 1 (Estimate.CdM2PerUnit); 1 where it is not known: then light is
        /// relative, and lux are not lux.</param>
        /// <exception cref="ArgumentException">The lamp has no direction or no colour.</exception>
        public UnityLight(Light lamp, Pipeline pipeline, float cdM2PerUnit = 1)
        {
            if (lamp.Direction.Count != 3 || lamp.Irradiance.Count != 3)
                throw new ArgumentException("lamp " + lamp.Id + ": expected three numbers each of direction and irradiance");
            List<float> towards = lamp.Direction;
            Forward = new[] { -towards[0], -towards[1], towards[2] };
            double scale = pipeline == Pipeline.HighDefinition ? cdM2PerUnit : 1 / Math.PI;
            double largest = 0;
            foreach (float channel in lamp.Irradiance) largest = Math.Max(largest, channel);
            Intensity = (float)(largest * scale);
            Colour = new float[3];
            for (int c = 0; c < 3; c++)
                Colour[c] = (float)Srgb(largest > 0 ? Math.Max(0.0, lamp.Irradiance[c]) / largest : 1);
            AngularDiameterDeg = 2 * lamp.AngularRadiusDeg;
            ShadowStrength = lamp.ShadowStrengthPermille / 1000f;
            CastsShadow = (lamp.Flags & (uint)LightFlag.Reflection) == 0;
        }

        /// <summary>A direction of the probe in Unity's axes (3).</summary>
        public static float[] Direction(IList<float> probe) => new[] { probe[0], probe[1], -probe[2] };

        /// <summary>
        /// The 27 numbers of a SphericalHarmonicsL2, [channel, coefficient], of the light that a white surface returns (E/π).
        /// Of order 4, the first nine coefficients are taken: a surface receives next to nothing of the rest.
        /// </summary>
        /// <param name="sh">Spherical harmonics of an estimate, order 0 to 4.</param>
        /// <param name="scale">1 for relative light; HDRP: Estimate.CdM2PerUnit.</param>
        public static float[,] SphericalHarmonicsL2(SphericalHarmonics sh, float scale = 1)
        {
            var l2 = new float[3, 9];
            for (int i = 0; i < Math.Min(9, sh.Coefficients.Count / 3); i++)
                for (int c = 0; c < 3; c++)
                    l2[c, i] = (float)(Sign[i] * Scale[i] * scale * sh.Coefficients[3 * i + c]);
            return l2;
        }

        private static double[] ShaderScale()
        {
            double[] squares = { 1, 3, 3, 3, 15, 15, 1.25, 15, 3.75 }, lobe = { 1, 2.0 / 3, 0.25 };
            var scale = new double[9];
            for (int i = 0; i < 9; i++) scale[i] = Math.Sqrt(squares[i] / (4 * Math.PI)) * lobe[(int)Math.Sqrt(i)];
            return scale;
        }

        private static double Srgb(double linear) =>
            linear <= 0.0031308 ? 12.92 * linear : 1.055 * Math.Pow(linear, 1 / 2.4) - 0.055;
    }
}
