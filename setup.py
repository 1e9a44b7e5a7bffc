"""Everything but ament's marker files is declared in setup.cfg."""

from setuptools import setup

setup(
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/barc_sim']),
        ('share/barc_sim', ['package.xml']),
    ],
)
