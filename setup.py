"""What cannot be declared in setup.cfg; everything else is."""

from setuptools import setup

setup(
    # colcon cannot read what setup.cfg would make of it.
    python_requires='>=3.10,<3.14',
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/barc_sim']),
        ('share/barc_sim', ['package.xml']),
    ],
)
