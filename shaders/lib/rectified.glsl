// SPDX-License-Identifier: Apache-2.0
// The rectified normal variable; the twin of asglight/shading/rectified.py.

// Return E[max(X, 0)] and P(X > 0) of a normal variable of a mean and a standard deviation.
// erfc by formula 7.1.26 of Abramowitz and Stegun, off by 1.5e-7 at most.
vec2 rectified(float mean, float deviation) {
    float u = mean / max(deviation, 1e-12) * 0.70710678118654752;
    float a = min(abs(u), 9.0);  // exp(-81) is 0 to a float, and u * u may be infinite
    float gaussian = exp(-a * a);
    float t = 1.0 / (1.0 + 0.3275911 * a);
    float series = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027
        + t * 1.061405429))));
    float tail = 0.5 * series * gaussian;
    float probability = u >= 0.0 ? 1.0 - tail : tail;
    return vec2(max(mean * probability + deviation * 0.39894228040143268 * gaussian, 0.0),
                probability);
}

// Return the deviation of the normal variable that stands for the cosine to a light.
float rectified_widened(float deviation) {
    const float WIDENING = 0.256;  // as in rectified.py
    return deviation * (1.0 + WIDENING * deviation * deviation);
}

// Return irradiance over pi, per unit of integral over pi, of a sheet whose cosine to the normal
// has a mean and a standard deviation.
float rectified_irradiance_over_pi(float mean, float deviation) {
    return rectified(mean, rectified_widened(deviation)).x;
}
