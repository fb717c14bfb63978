// SPDX-License-Identifier: Apache-2.0
using UnityEngine;

namespace Lightprobe
{
    /// <summary>A directional light that comes, moves and goes without a jump. Main thread only.</summary>
    internal sealed class LampFade
    {
        private const float Dark = 0.01f;

        /// <summary>Share of its intensity that it goes to: 1, or 0 when the probe lists it no more.</summary>
        internal float Goal = 1;

        private readonly UnityEngine.Light _light;
        private float _intensity, _shown;

        internal LampFade(Transform parent)
        {
            var holder = new GameObject("lamp");
            holder.transform.SetParent(parent, false);
            _light = holder.AddComponent<UnityEngine.Light>();
            _light.type = LightType.Directional;
            _light.intensity = 0;
        }

        internal void Aim(UnityLight light)
        {
            Goal = 1;
            _intensity = light.Intensity;
            _light.shadows = light.CastsShadow ? LightShadows.Soft : LightShadows.None;
            _light.color = new Color(light.Colour[0], light.Colour[1], light.Colour[2]);
            var forward = new Vector3(light.Forward[0], light.Forward[1], light.Forward[2]);
            // LookRotation needs an up that is not along forward.
            Vector3 up = Mathf.Abs(forward.y) > 0.99f ? Vector3.forward : Vector3.up;
            _light.transform.localRotation = Quaternion.LookRotation(forward, up);
        }

        /// <summary>Goes on; false: it is dark, and its object is gone.</summary>
        internal bool Step(float share)
        {
            _shown += share * (Goal - _shown);
            _light.intensity = _shown * _intensity;
            if (Goal > 0 || _shown > Dark) return true;
            Object.Destroy(_light.gameObject);
            return false;
        }
    }
}
