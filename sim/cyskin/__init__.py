"""The CySkin: where its taxels lie and what they count under a pressure."""
