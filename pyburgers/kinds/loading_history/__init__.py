"""Tests under any history of strain and stress: creep, steps, relaxation, measured drivers."""
