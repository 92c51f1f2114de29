"""Tables of attenuation and modulus against period and temperature."""
